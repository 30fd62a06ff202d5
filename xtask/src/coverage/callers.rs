//! Which functions of libraries are called only by panics and the log, and so are part of them.
//!
//! Functions of this workspace are not asked: a line that writes a message may also call what decides.

use std::collections::{BTreeMap, BTreeSet};

use cortex_m4::coverage::Flow;

use super::image::Image;
use super::part::Part;

/// Makes each function of a library that only panics and the log call a part of them, and what only those call, and
/// so on. A function without a caller, or one whose address is known somewhere, may be called from anywhere and stays.
pub(super) fn follow(image: &Image, parts: &mut BTreeMap<u32, Part>) {
    let mut callers: BTreeMap<usize, BTreeSet<u32>> = BTreeMap::new();
    for (&address, instruction) in &image.code {
        let (Flow::Call(target) | Flow::To(target) | Flow::Either(target)) = instruction.flow else { continue };
        let called = image.code.get(&(target & !1)).map(|called| called.function);
        if let Some(called) = called.filter(|called| *called != instruction.function) {
            callers.entry(called).or_default().insert(address);
        }
    }
    callers.retain(|function, _| {
        let function = &image.functions[*function];
        let mut own = parts.range(function.start..function.end).map(|(_, part)| part);
        own.all(|part| matches!(part, Part::Library | Part::Panic | Part::Log))
            && !image.known.contains(&function.start)
    });
    loop {
        let is_aside = |address: &u32| matches!(parts[address], Part::Panic | Part::Log);
        let follows = |callers: &BTreeSet<u32>| callers.iter().all(is_aside);
        let Some(function) = callers.iter().find(|(_, callers)| follows(callers)).map(|(function, _)| *function) else {
            return;
        };
        let of = callers.remove(&function).unwrap_or_default();
        let part = if of.iter().all(|address| parts[address] == Part::Panic) { Part::Panic } else { Part::Log };
        let called = &image.functions[function];
        for (_, own) in parts.range_mut(called.start..called.end) {
            if *own == Part::Library {
                *own = part;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::image::Function;

    /// Two functions: `bl` to the second; `bx lr`. The second: `bx lr`.
    fn image() -> Image {
        let mut image = Image::of(0x100, &[0xF000, 0xF801, 0x4770, 0x4770], &[]);
        let function = |name: &str, start, end| Function { name: name.into(), start, end };
        image.functions = vec![function("caller", 0x100, 0x106), function("called", 0x106, 0x108)];
        image.code.get_mut(&0x106).unwrap().function = 1;
        image
    }

    fn part_of_called(image: &Image, caller: Part) -> Part {
        part_after(image, caller, Part::Library)
    }

    fn part_after(image: &Image, caller: Part, called: Part) -> Part {
        let mut parts = [(0x100, caller), (0x104, caller), (0x106, called)].into();
        follow(image, &mut parts);
        parts[&0x106]
    }

    #[test]
    fn a_function_follows_its_only_caller_into_panic_and_log() {
        assert_eq!(part_of_called(&image(), Part::Panic), Part::Panic);
        assert_eq!(part_of_called(&image(), Part::Log), Part::Log);
        assert_eq!(part_of_called(&image(), Part::Deciding), Part::Library);
    }

    #[test]
    fn own_code_follows_nobody() {
        for part in [Part::Deciding, Part::Deadline, Part::Other] {
            assert_eq!(part_after(&image(), Part::Log, part), part);
        }
    }

    #[test]
    fn a_function_whose_address_is_known_follows_nobody() {
        let image = Image { known: [0x106].into(), ..image() };
        assert_eq!(part_of_called(&image, Part::Log), Part::Library);
    }
}
