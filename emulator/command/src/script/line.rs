//! Reads the lines of a script.

use emulator_part::{Pin, Pins};

/// An action of the firmware that a line of a script may expect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Deed {
    /// A pin becomes high (`true`) or low.
    Edge(Pin, bool),
    /// Text is sent from the pin of a UART.
    Sent(Pin, Vec<u8>),
    /// A line of the log has this text in it.
    Logged(String),
    /// The firmware exits with this status.
    Exit(u32),
    /// The part restarts.
    Restart,
}

/// A command of a script. Times are in virtual nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Command {
    Watch(Pin),
    Drive(Pin, bool),
    Release(Pin),
    Uart(Pin, u32),
    Send(Pin, Vec<u8>),
    Reset,
    Run(u64),
    Check(Pin, bool),
    Expect(Deed, u64),
    Never(Deed, u64),
    Pass,
    Fail(String),
}

/// The time within which an action is expected if the line states none.
const DEFAULT_WITHIN: u64 = 1_000_000_000;
/// The longest time that a line may state: a day.
const LONGEST: f64 = 86_400e9;

#[derive(Clone, Debug, PartialEq, Eq)]
enum Token {
    Word(String),
    Text(Vec<u8>),
}

impl Token {
    fn shown(&self) -> String {
        match self {
            Self::Word(word) => word.clone(),
            Self::Text(bytes) => quoted(bytes),
        }
    }
}

/// Decodes bytes as a script writes them.
pub(crate) fn quoted(bytes: &[u8]) -> String {
    let text: String = bytes
        .utf8_chunks()
        .flat_map(|chunk| {
            let valid = chunk.valid().chars().map(|letter| match letter {
                '\n' => "\\n".to_owned(),
                '\r' => "\\r".to_owned(),
                '\t' => "\\t".to_owned(),
                '"' | '\\' => format!("\\{letter}"),
                letter if letter.is_control() && letter.is_ascii() => format!("\\x{:02x}", u32::from(letter)),
                letter => letter.to_string(),
            });
            valid.chain(chunk.invalid().iter().map(|byte| format!("\\x{byte:02x}"))).collect::<Vec<_>>()
        })
        .collect();
    format!("\"{text}\"")
}

/// Returns a line without its comment. A comment begins with a `#` that is outside a text.
pub(crate) fn code(line: &str) -> &str {
    let (mut in_text, mut escaped) = (false, false);
    let is_comment = |letter: char| {
        in_text ^= letter == '"' && !escaped;
        escaped = in_text && letter == '\\' && !escaped;
        letter == '#' && !in_text
    };
    line[..line.find(is_comment).unwrap_or(line.len())].trim()
}

fn tokens(line: &str) -> Result<Vec<Token>, String> {
    let (mut tokens, mut rest) = (vec![], line);
    while !rest.is_empty() {
        if let Some(behind) = rest.strip_prefix('"') {
            let (bytes, behind) = text(behind)?;
            tokens.push(Token::Text(bytes));
            rest = behind;
        } else {
            let end = rest.find(|letter: char| letter.is_whitespace() || letter == '"').unwrap_or(rest.len());
            tokens.push(Token::Word(rest[..end].to_owned()));
            rest = &rest[end..];
        }
        rest = rest.trim_start();
    }
    Ok(tokens)
}

/// Reads a text from behind its opening quotation mark. Returns its bytes, and what follows the closing mark.
fn text(line: &str) -> Result<(Vec<u8>, &str), String> {
    let mut bytes = vec![];
    let mut letters = line.char_indices();
    while let Some((at, letter)) = letters.next() {
        match letter {
            '"' => return Ok((bytes, &line[at + 1..])),
            '\\' => {
                let (_, escaped) = letters.next().unwrap_or((at, ' '));
                bytes.push(match escaped {
                    'n' => b'\n',
                    'r' => b'\r',
                    't' => b'\t',
                    '0' => 0,
                    '"' | '\\' => escaped as u8,
                    'x' => {
                        let digits = line
                            .get(at + 2..at + 4)
                            .filter(|digits| digits.bytes().all(|digit| digit.is_ascii_hexdigit()));
                        let byte = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok());
                        letters.nth(1);
                        byte.ok_or_else(|| "expected two hexadecimal digits behind \\x".to_owned())?
                    }
                    _ => {
                        return Err(format!(
                            "expected \\n, \\r, \\t, \\0, \\\", \\\\ or \\x and two digits, not \\{escaped}"
                        ));
                    }
                });
            }
            letter => bytes.extend_from_slice(letter.encode_utf8(&mut [0; 4]).as_bytes()),
        }
    }
    Err("a text has no closing quotation mark".to_owned())
}

struct Line<'a> {
    tokens: std::vec::IntoIter<Token>,
    pins: &'a Pins,
    part: &'a str,
}

impl Line<'_> {
    fn next(&mut self, expected: &str) -> Result<Token, String> {
        self.tokens.next().ok_or_else(|| format!("expected {expected}, and the line ends"))
    }

    fn word(&mut self, expected: &str) -> Result<String, String> {
        match self.next(expected)? {
            Token::Word(word) => Ok(word),
            text => Err(format!("expected {expected}, not {}", text.shown())),
        }
    }

    fn text(&mut self) -> Result<Vec<u8>, String> {
        match self.next("a text in quotation marks")? {
            Token::Text(bytes) if bytes.is_empty() => Err("expected a text that is not empty".to_owned()),
            Token::Text(bytes) => Ok(bytes),
            word => Err(format!("expected a text in quotation marks, not {}", word.shown())),
        }
    }

    fn string(&mut self) -> Result<String, String> {
        String::from_utf8(self.text()?).map_err(|_| "expected a text in UTF-8".to_owned())
    }

    fn pin(&mut self) -> Result<Pin, String> {
        let name = self.word("a pin")?;
        self.pin_called(&name)
    }

    fn pin_called(&self, name: &str) -> Result<Pin, String> {
        self.pins.find(name).ok_or_else(|| format!("the {} has no pin {name}: it has {}", self.part, self.pins))
    }

    fn number(&mut self, expected: &str, most: u32) -> Result<u32, String> {
        let word = self.word(expected)?;
        word.parse().ok().filter(|number| *number <= most).ok_or_else(|| format!("expected {expected}, not {word}"))
    }

    fn level(&mut self) -> Result<bool, String> {
        match self.word("high or low")?.as_str() {
            "high" => Ok(true),
            "low" => Ok(false),
            other => Err(format!("expected high or low, not {other}")),
        }
    }

    fn time(&mut self) -> Result<u64, String> {
        let expected = "a time like 20 ms";
        let word = self.word(expected)?;
        let unit_at = word.find(|letter: char| letter.is_alphabetic()).unwrap_or(word.len());
        let (number, unit) = word.split_at(unit_at);
        let unit = if unit.is_empty() { self.word("s, ms, us or ns")? } else { unit.to_owned() };
        let ns = match unit.as_str() {
            "s" => 1e9,
            "ms" => 1e6,
            "us" | "µs" => 1e3,
            "ns" => 1.0,
            other => return Err(format!("expected s, ms, us or ns, not {other}")),
        };
        let ns = number.parse::<f64>().ok().map(|number| number * ns).filter(|ns| (1.0..=LONGEST).contains(ns));
        ns.map(|ns| ns.round() as u64).ok_or_else(|| format!("expected {expected}, up to a day, not {word}"))
    }

    fn deed(&mut self) -> Result<Deed, String> {
        let subject = self.word("a pin, log, exit or restart")?;
        match subject.as_str() {
            "log" => Ok(Deed::Logged(self.string()?)),
            "exit" => Ok(Deed::Exit(self.number("an exit status", u32::MAX)?)),
            "restart" => Ok(Deed::Restart),
            name => {
                let pin = self.pin_called(name)?;
                match self.next("rise, fall or a text in quotation marks")? {
                    Token::Word(word) if word == "rise" => Ok(Deed::Edge(pin, true)),
                    Token::Word(word) if word == "fall" => Ok(Deed::Edge(pin, false)),
                    Token::Text(bytes) if !bytes.is_empty() => Ok(Deed::Sent(pin, bytes)),
                    other => Err(format!("expected rise, fall or a text in quotation marks, not {}", other.shown())),
                }
            }
        }
    }

    fn keyword(&mut self, keyword: &str) -> Result<(), String> {
        match self.word(keyword)? {
            word if word == keyword => Ok(()),
            word => Err(format!("expected {keyword}, not {word}")),
        }
    }

    fn within(&mut self) -> Result<u64, String> {
        if self.tokens.len() == 0 {
            return Ok(DEFAULT_WITHIN);
        }
        self.keyword("within")?;
        self.time()
    }
}

/// Reads one line of a script; `None` for one without a command.
///
/// # Errors
///
/// Returns a message that says what was expected and what the line has in its place.
pub(crate) fn parse(line: &str, pins: &Pins, part: &str) -> Result<Option<Command>, String> {
    let mut line = Line { tokens: tokens(code(line))?.into_iter(), pins, part };
    let Some(first) = line.tokens.next() else { return Ok(None) };
    let command = match &first {
        Token::Word(word) => match word.as_str() {
            "watch" => Command::Watch(line.pin()?),
            "drive" => Command::Drive(line.pin()?, line.level()?),
            "release" => Command::Release(line.pin()?),
            "uart" => Command::Uart(line.pin()?, line.number("1 to 10000000 bits a second", 10_000_000)?.max(1)),
            "send" => Command::Send(line.pin()?, line.text()?),
            "reset" => Command::Reset,
            "run" => Command::Run(line.time()?),
            "check" => Command::Check(line.pin()?, line.level()?),
            "expect" => Command::Expect(line.deed()?, line.within()?),
            "never" => {
                let deed = line.deed()?;
                line.keyword("for")?;
                Command::Never(deed, line.time()?)
            }
            "pass" => Command::Pass,
            "fail" => Command::Fail(line.string()?),
            _ => return Err(unknown(&first)),
        },
        Token::Text(_) => return Err(unknown(&first)),
    };
    match line.tokens.next() {
        None => Ok(Some(command)),
        Some(more) => Err(format!("expected the end of the line, not {}", more.shown())),
    }
}

fn unknown(first: &Token) -> String {
    let known = "watch, drive, release, uart, send, reset, run, check, expect, never, pass or fail";
    format!("expected {known}, not {}", first.shown())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PINS: Pins = Pins { ports: &[("P0.", 32), ("P1.", 16)], digits: 2 };

    fn read(line: &str) -> Result<Option<Command>, String> {
        parse(line, &PINS, "nRF52840")
    }

    #[test]
    fn each_command_is_read_with_its_pins_times_and_texts() {
        let (pin, ms) = (Pin::new(0, 13), 1_000_000);
        for (line, command) in [
            ("watch P0.13", Command::Watch(pin)),
            ("drive p0.13 high # pressed", Command::Drive(pin, true)),
            ("release P0.13", Command::Release(pin)),
            ("uart P0.13 115200", Command::Uart(pin, 115_200)),
            (r##"send P0.13 "a\"#\x0d\n""##, Command::Send(pin, b"a\"#\r\n".to_vec())),
            ("reset", Command::Reset),
            ("run 1.5s", Command::Run(1_500 * ms)),
            ("check P0.13 low", Command::Check(pin, false)),
            ("expect P0.13 rise within 20 ms", Command::Expect(Deed::Edge(pin, true), 20 * ms)),
            ("expect P0.13 fall", Command::Expect(Deed::Edge(pin, false), 1_000 * ms)),
            ("expect P0.13 \"OK\" within 500us", Command::Expect(Deed::Sent(pin, b"OK".to_vec()), ms / 2)),
            ("expect log \"ready\"", Command::Expect(Deed::Logged("ready".to_owned()), 1_000 * ms)),
            ("expect exit 3", Command::Expect(Deed::Exit(3), 1_000 * ms)),
            ("never restart for 2 s", Command::Never(Deed::Restart, 2_000 * ms)),
            ("pass", Command::Pass),
            ("fail \"no\"", Command::Fail("no".to_owned())),
        ] {
            assert_eq!(read(line), Ok(Some(command)), "{line}");
        }
        assert_eq!([read(""), read("  # only a comment")], [Ok(None), Ok(None)]);
    }

    #[test]
    fn a_wrong_line_says_what_was_expected_and_what_came() {
        for (line, words) in [
            ("blink P0.13", "run, check, expect, never, pass or fail, not blink"),
            ("drive P1.16 high", "the nRF52840 has no pin P1.16: it has P0.00 to P0.31, P1.00 to P1.15"),
            ("drive P0.13 1", "expected high or low, not 1"),
            ("drive P0.13", "expected high or low, and the line ends"),
            ("run 20", "expected s, ms, us or ns, and the line ends"),
            ("run 20 min", "expected s, ms, us or ns, not min"),
            ("run -1 ms", "expected a time like 20 ms, up to a day, not -1"),
            ("uart P0.13 fast", "expected 1 to 10000000 bits a second, not fast"),
            ("send P0.13 OK", "expected a text in quotation marks, not OK"),
            ("expect P0.13 rises", "expected rise, fall or a text in quotation marks, not rises"),
            ("expect P0.13 rise in 3 ms", "expected within, not in"),
            ("never restart within 2 s", "expected for, not within"),
            ("expect log \"ready", "no closing quotation mark"),
            ("expect log \"\\q\"", "not \\q"),
            ("expect log \"\\xg\"", "two hexadecimal digits"),
            ("pass now", "expected the end of the line, not now"),
        ] {
            let error = read(line).unwrap_err();
            assert!(error.contains(words), "{line}: {error}");
        }
    }

    #[test]
    fn quoted_bytes_read_back_as_they_were() {
        let all: Vec<u8> = (0..=255).collect();
        for bytes in [&all[..], "grüße\r\n".as_bytes()] {
            let line = format!("send P0.13 {}", quoted(bytes));
            assert_eq!(read(&line), Ok(Some(Command::Send(Pin::new(0, 13), bytes.to_vec()))), "{line}");
        }
    }
}
