//! The differences between two results of a case, in words.

use crate::image::{Case, RESULT_WORDS, code_address};

fn name(index: usize) -> String {
    match index {
        0..=11 => format!("r{}", index + 1),
        12 => "lr".into(),
        13 => "apsr".into(),
        14 => "fpscr".into(),
        15..=46 => format!("s{}", index - 15),
        47 => "sp".into(),
        48 => "r0".into(),
        49 => "cfsr".into(),
        50 => "hfsr".into(),
        51 => "fault address".into(),
        52 => "fault pc".into(),
        53 => "fault xpsr".into(),
        54 => "exc_return and ipsr".into(),
        _ => format!("window[{}]", index - 55),
    }
}

/// The case's instructions and each word that differs; `None` if the results are equal.
#[must_use]
pub fn difference(index: usize, case: &Case, reference: &[u32], ours: &[u32]) -> Option<String> {
    assert_eq!((reference.len(), ours.len()), (RESULT_WORDS, RESULT_WORDS));
    if reference == ours {
        return None;
    }
    let mut text = format!("at {:#010x}:", code_address(index));
    for half in &case.code {
        text += &format!(" {half:04x}");
    }
    for (word, (theirs, ours)) in reference.iter().zip(ours).enumerate().filter(|(_, (a, b))| a != b) {
        text += &format!("; {} {theirs:08x}, ours {ours:08x}", name(word));
    }
    Some(text)
}
