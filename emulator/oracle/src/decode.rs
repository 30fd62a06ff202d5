//! Compares the bench's decoder with LLVM's disassembler: which encodings are instructions, and with which registers.
//!
//! All 16-bit encodings are compared, and [`SECONDS`] second halfwords for each first halfword of a 32-bit encoding.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, ensure};

use crate::random::Random;

/// The number of second halfwords that are tried with each first halfword of a 32-bit encoding.
pub const SECONDS: usize = 16;

/// One encoding: first and second halfword. The second is 0 in a 16-bit encoding.
pub type Encoding = (u16, u16);

/// The encodings that are compared. The list is always the same.
#[must_use]
pub fn encodings() -> Vec<Encoding> {
    let mut random = Random::new(0, 0);
    let mut encodings: Vec<Encoding> = (0..0xE800).map(|first| (first, 0)).collect();
    for first in 0xE800..=0xFFFF {
        for _ in 0..SECONDS {
            let mut second = random.bits() as u16;
            // Random bits alone would rarely contain the registers 13 and 15, or a field of only zeros or ones.
            for nibble in 0..4 {
                match random.below(8) {
                    0 => second |= 0xF << (4 * nibble),
                    1 => second = second & !(0xF << (4 * nibble)) | 0xD << (4 * nibble),
                    2 | 3 => second &= !(0xF << (4 * nibble)),
                    _ => {}
                }
            }
            encodings.push((first, second));
        }
    }
    encodings
}

/// The distance of two encodings in the object file, in bytes. NOPs fill the space between them, so that an IT or an
/// unknown encoding does not change how the next one is decoded.
const SLOT: usize = 12;

/// LLVM's text of each encoding, empty if the encoding is no instruction.
///
/// # Errors
///
/// Returns an error if the disassembler is not installed or failed.
pub fn reference(encodings: &[Encoding], directory: &Path) -> anyhow::Result<Vec<String>> {
    std::fs::create_dir_all(directory)?;
    let mut code = Vec::new();
    for &(first, second) in encodings {
        let mut halves = [0xBF00_u16; SLOT / 2];
        halves[0] = first;
        if first >= 0xE800 {
            halves[1] = second;
        }
        code.extend(halves.iter().flat_map(|half| half.to_le_bytes()));
    }
    let path = directory.join("encodings.o");
    std::fs::write(&path, object(&code))?;
    let output = Command::new(disassembler()?)
        .args(["-d", "--triple=thumbv7em-none-eabihf", "--mcpu=cortex-m4", "--no-show-raw-insn"])
        .arg(&path)
        .output()?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    let mut at = HashMap::new();
    for line in text.lines() {
        let Some((address, rest)) = line.trim_start().split_once(':') else { continue };
        if let Ok(address) = usize::from_str_radix(address, 16) {
            at.insert(address, rest.trim().replace('\t', " "));
        }
    }
    (0..encodings.len())
        .map(|i| {
            let text = at.get(&(i * SLOT)).with_context(|| format!("no line for encoding {:04x?}", encodings[i]))?;
            Ok(if text.contains("<unknown>") { String::new() } else { text.clone() })
        })
        .collect()
}

fn disassembler() -> anyhow::Result<PathBuf> {
    let output = Command::new("rustc").args(["--print", "sysroot"]).output()?;
    let libraries = PathBuf::from(String::from_utf8(output.stdout)?.trim()).join("lib/rustlib");
    for entry in std::fs::read_dir(&libraries)? {
        let path = entry?.path().join("bin/llvm-objdump");
        if path.exists() {
            return Ok(path);
        }
    }
    anyhow::bail!("no llvm-objdump below {}: `rustup component add llvm-tools`", libraries.display())
}

fn object(code: &[u8]) -> Vec<u8> {
    let names = b"\0.text\0.symtab\0.strtab\0";
    let strings = b"\0$t\0";
    let text_at = 52;
    let symbols_at = text_at + code.len() as u32;
    let strings_at = symbols_at + 32;
    let names_at = strings_at + 4;
    let headers_at = names_at + 24;
    let mut elf = vec![0x7F, b'E', b'L', b'F', 1, 1, 1];
    elf.resize(16, 0);
    let half = |elf: &mut Vec<u8>, value: u16| elf.extend(value.to_le_bytes());
    let word = |elf: &mut Vec<u8>, value: u32| elf.extend(value.to_le_bytes());
    // The two header fields are ET_REL (a relocatable file) and EM_ARM.
    half(&mut elf, 1);
    half(&mut elf, 40);
    for value in [1, 0, 0, headers_at, 0x0500_0000] {
        word(&mut elf, value);
    }
    for value in [52, 0, 0, 40, 5, 4] {
        half(&mut elf, value);
    }
    elf.extend(code);
    // The table has the null symbol, and then $t at 0 in section 1.
    elf.extend([0; 16]);
    for value in [1, 0, 0] {
        word(&mut elf, value);
    }
    half(&mut elf, 0);
    half(&mut elf, 1);
    elf.extend(strings);
    elf.extend(names);
    elf.resize(headers_at as usize, 0);
    let sections: [[u32; 10]; 5] = [
        [0; 10],
        [1, 1, 6, 0, text_at, code.len() as u32, 0, 0, 4, 0],
        [7, 2, 0, 0, symbols_at, 32, 3, 2, 4, 16],
        [15, 3, 0, 0, strings_at, 4, 0, 0, 1, 0],
        [15, 3, 0, 0, names_at, names.len() as u32, 0, 0, 1, 0],
    ];
    for value in sections.iter().flatten() {
        word(&mut elf, *value);
    }
    elf
}

/// The verdict on one encoding: whether the bench's decoder (ours) and LLVM accept it as an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Neither decoder has an instruction.
    Neither = 0,
    /// Both decoders have an instruction. An absent coprocessor's fault counts as an instruction.
    Both = 1,
    /// LLVM has an instruction. Our decoder has none, because the encoding is UNPREDICTABLE.
    OursUndefined = 2,
    /// Our decoder has an instruction and LLVM has none: an unallocated hint, or MSR of a missing register.
    OursExecutes = 3,
}

/// The verdict on an encoding. `known` says whether LLVM has an instruction.
#[must_use]
pub fn verdict(known: bool, (first, second): Encoding) -> Verdict {
    let undefined = cortex_m4::describe(0, first, second).1 == "Fault(Undefined)";
    match (known, undefined) {
        (false, true) => Verdict::Neither,
        (true, false) => Verdict::Both,
        (true, true) => Verdict::OursUndefined,
        (false, false) => Verdict::OursExecutes,
    }
}

/// The result of the comparison with LLVM.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The number of encodings of each [`Verdict`].
    pub counts: [usize; 4],
    /// The encodings with different registers in the two decoders: the encoding, LLVM's text, and ours.
    pub registers_differ: Vec<String>,
    /// The verdicts on [`encodings`], two bits each, the first in the lowest bits.
    pub verdicts: Vec<u8>,
}

/// Compares our decoder with LLVM's.
///
/// # Errors
///
/// Returns an error if the disassembler is not installed or failed.
pub fn compare(directory: &Path) -> anyhow::Result<Report> {
    let encodings = encodings();
    let texts = reference(&encodings, directory)?;
    let mut report = Report { verdicts: vec![0; encodings.len().div_ceil(4)], ..Report::default() };
    for (i, (&encoding, text)) in encodings.iter().zip(&texts).enumerate() {
        let verdict = verdict(!text.is_empty(), encoding);
        report.counts[verdict as usize] += 1;
        report.verdicts[i / 4] |= (verdict as u8) << (2 * (i % 4));
        let ours = cortex_m4::describe(0, encoding.0, encoding.1).1;
        let comparable = !ours.starts_with("Fault") && !ours.starts_with("Nop");
        if verdict == Verdict::Both && comparable && their_registers(text) != our_registers(&ours) {
            report.registers_differ.push(format!("{:04x} {:04x}: {text}; {ours}", encoding.0, encoding.1));
        }
    }
    Ok(report)
}

/// Returns the core registers in LLVM's text as a set. The program counter is left out, because our text gives it as an
/// address.
fn their_registers(text: &str) -> u16 {
    let text = text.split('@').next().unwrap_or_default();
    let words = text.split(|c: char| !c.is_ascii_alphanumeric()).skip(1);
    let implied = if text.starts_with("push") || text.starts_with("pop") { 1 << 13 } else { 0 };
    words.fold(implied, |set, word| {
        let number = match word {
            "sp" => Some(13),
            "lr" => Some(14),
            _ => word.strip_prefix('r').and_then(|digits| digits.parse::<u32>().ok()),
        };
        set | number.map_or(0, |n| 1 << n)
    })
}

fn our_registers(text: &str) -> u16 {
    let floating = text.starts_with("Fp(");
    let moves = text.starts_with("AluS") || text.starts_with("AluI");
    let alu = |name: &str| text.contains(&format!("alu: {name},"));
    let mut set = 0;
    let fields = text.split(['{', '}', ',', '(', ')']).filter_map(|field| field.trim().split_once(": "));
    for (name, value) in fields {
        let Ok(value) = value.parse::<u32>() else { continue };
        let register = match name {
            "t" | "t2" | "base" => true,
            "n" if moves && (alu("Mov") || alu("Mvn")) => false,
            "d" if moves && (alu("Tst") || alu("Teq") || alu("Cmp") || alu("Cmn")) => false,
            "d" | "n" | "m" | "a" | "low" | "high" => !floating,
            "list" => {
                set |= value as u16;
                false
            }
            _ => false,
        };
        if register && value < 16 {
            set |= 1 << value;
        }
    }
    set & 0x7FFF
}
