//! The codes whose error detection is calculated: the profile's two polynomials, and others for comparison, at every
//! length in use.
use std::fmt::Write as _;
use std::num::NonZero;
use std::sync::LazyLock;

use crate::{DualWeights, NotADual, Polynomial, Weights};

/// A polynomial and its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Named {
    /// The polynomial's name in tables.
    pub name: &'static str,
    /// The polynomial.
    pub polynomial: Polynomial,
}

const fn named(name: &'static str, koopman: u32) -> Named {
    match Polynomial::from_koopman(32, koopman) {
        Some(polynomial) => Named { name, polynomial },
        None => panic!("not of degree 32"),
    }
}

/// The frame CRC (paper, section 2.3), which closes every object: 0xF1922815 in the usual notation.
pub const FRAME: Named = named("frame", 0xF8C9_140A);

/// The position CRC (paper, section 2.3), over latitude and longitude: 0x3AFF2FAD in the usual notation.
pub const POSITION: Named = named("position", 0x9D7F_97D6);

/// The polynomial of IEEE 802.3, best known as 0x04C11DB7 in the usual notation.
pub const IEEE_802_3: Named = named("IEEE 802.3", 0x8260_8EDB);

/// The polynomial of CRC-32C (Castagnoli; iSCSI, RFC 3720), 0x1EDC6F41 in the usual notation.
pub const CRC_32C: Named = named("CRC-32C", 0x8F6E_37A0);

/// The polynomial of CRC-32Q (aeronautical data; AIXM, ARINC 424), 0x814141AB in the usual notation.
pub const CRC_32Q: Named = named("CRC-32Q", 0xC0A0_A0D5);

/// The polynomial of OPC UA Safety (OPC 10000-15, RQ7.22), also AUTOSAR's CRC32P4: both write 0xF4ACFB13 in the usual
/// notation. Read in Koopman's notation, 0xF4ACFB13 would be another polynomial, without the published distances.
pub const OPC_UA_SAFETY: Named = named("OPC UA Safety", 0xFA56_7D89);

/// All polynomials that are compared, with the profile's two first.
pub const POLYNOMIALS: [Named; 6] = [FRAME, POSITION, IEEE_802_3, CRC_32C, CRC_32Q, OPC_UA_SAFETY];

/// The length of latitude, longitude and the position CRC together, bits.
pub const POSITION_BITS: usize = 160;
/// The length of a GPS object, bits.
pub const GPS_BITS: usize = 8 * profile::GpsObject::SIZE;
/// The length of Reported-Position, bits.
pub const REPORTED_BITS: usize = 8 * profile::ReportedPosition::SIZE;
/// The length of Link-Status, bits.
pub const LINK_STATUS_BITS: usize = 8 * profile::LinkStatus::SIZE;
/// The length of a request on the SSI, bits.
pub const REQUEST_BITS: usize = 64;

/// The lengths at which all polynomials are compared.
pub const COMPARED: [usize; 3] = [POSITION_BITS, GPS_BITS, REPORTED_BITS];

/// The code of a CRC: a polynomial, and the length of the codeword.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// The polynomial.
    pub named: Named,
    /// The length of the codeword, check bits included, bits.
    pub bits: usize,
}

impl Code {
    /// All codes whose error detection is calculated, by length: all polynomials at the lengths of the profile's
    /// objects, and the frame CRC at the lengths of Link-Status and of a request on the SSI.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let compared = COMPARED.iter().flat_map(|bits| POLYNOMIALS.map(|named| Self { named, bits: *bits }));
        let ssi = [REQUEST_BITS, LINK_STATUS_BITS].map(|bits| Self { named: FRAME, bits });
        let mut all: Vec<Self> = compared.chain(ssi).collect();
        all.sort_by_key(|code| code.bits);
        all
    }

    /// Counts the words of the code's dual, which takes seconds. `progress` gets the finished share, 0 to 1.
    #[must_use]
    pub fn count(self, threads: NonZero<usize>, progress: &(dyn Fn(f64) + Sync)) -> DualWeights {
        DualWeights::count(self.named.polynomial, self.bits, threads, progress)
    }

    /// The committed weights of the code's dual; `None` for a code that is not among [`Code::all`].
    #[must_use]
    pub fn committed(self) -> Option<DualWeights> {
        COMMITTED.iter().find(|(code, _)| *code == self).map(|(_, dual)| dual.clone())
    }

    /// The code's weight distribution, from the committed weights of its dual.
    ///
    /// # Errors
    ///
    /// [`NotADual`] if the committed weights cannot be those of a dual code.
    ///
    /// # Panics
    ///
    /// Panics if the code is not among [`Code::all`].
    pub fn weights(self) -> Result<Weights, NotADual> {
        let dual = self.committed().unwrap_or_else(|| panic!("no weights are committed for {self:?}"));
        Weights::from_dual(&dual, self.named.polynomial.degree())
    }
}

/// The path of the committed weights of the duals, from the workspace's root.
pub const COMMITTED_PATH: &str = "residual/data/dual-weights.txt";

static COMMITTED: LazyLock<Vec<(Code, DualWeights)>> =
    LazyLock::new(|| parse(include_str!("../data/dual-weights.txt")));

fn parse(text: &str) -> Vec<(Code, DualWeights)> {
    let line = |line: &str| {
        let mut words = line.split(' ');
        let koopman = u32::from_str_radix(words.next()?.strip_prefix("0x")?, 16).ok()?;
        let named = *POLYNOMIALS.iter().find(|named| named.polynomial.koopman() == koopman)?;
        let bits = words.next()?.parse().ok()?;
        let mut counts = vec![0; bits + 1];
        for entry in words {
            let (weight, count) = entry.split_once(':')?;
            *counts.get_mut(weight.parse::<usize>().ok()?)? = count.parse().ok()?;
        }
        Some((Code { named, bits }, DualWeights::from_counts(counts)))
    };
    // A line that cannot be read is skipped. A later request for that line's code then fails.
    text.lines().filter(|text| !text.starts_with('#')).filter_map(line).collect()
}

/// The text of the file of committed weights.
#[must_use]
pub fn committed_text(duals: &[(Code, DualWeights)]) -> String {
    let mut text = String::from(
        "# Weights of the dual codes, counted by `cargo xtask residual --store`: polynomial (Koopman), codeword bits, \
         weight:words.\n",
    );
    for (code, dual) in duals {
        let _ = write!(text, "{} {}", code.named.polynomial, code.bits);
        for (weight, count) in dual.counts().iter().enumerate().filter(|(_, count)| **count > 0) {
            let _ = write!(text, " {weight}:{count}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_committed_text_is_what_its_content_is_written_as() {
        assert_eq!(committed_text(&COMMITTED), include_str!("../data/dual-weights.txt"));
    }

    #[test]
    fn every_code_is_committed_and_transforms_to_a_weight_distribution() {
        for code in Code::all() {
            let weights = code.weights().unwrap();
            assert_eq!((weights.length(), weights.check_bits()), (code.bits, 32));
            if code.named.polynomial.is_even() {
                assert!(weights.nonzero().all(|(weight, _)| weight % 2 == 0), "{code:?}");
            }
        }
    }
}
