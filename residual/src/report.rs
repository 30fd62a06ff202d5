//! The complete report: the output of `cargo xtask residual`, its JSON, and the tables of its page.
use std::fmt::Write as _;
use std::num::NonZero;

use serde::{Serialize, Serializer};

use crate::codes::{self, FRAME, Named, POSITION};
use crate::joint::{Joint, Nesting};
use crate::rate::{self, ProfileCurves, Sil};
use crate::wire::{self, Check, Expected};
use crate::{BitErrorRate, Code, DualWeights, ErrorCurve, NotADual, Weights, burst, undetected_exactly};

/// The path of the report, from the workspace's root.
pub const REPORT_PATH: &str = "docs/safety/residual-error.md";
/// The path of the report's plot, from the workspace's root.
pub const PLOT_PATH: &str = "docs/safety/residual-error.svg";

const HOURS_PER_YEAR: f64 = 8766.0;

/// A code, with all results that follow from its weights.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The code.
    pub code: Code,
    /// The code's weight distribution.
    pub weights: Weights,
    /// The code's error curve.
    pub curve: ErrorCurve,
    /// P_ud at the tabulated bit error rates, calculated exactly and rounded once.
    pub undetected: Vec<(BitErrorRate, f64)>,
}

impl Judged {
    fn undetected_at(&self, rate: BitErrorRate) -> f64 {
        self.undetected.iter().find(|(at, _)| *at == rate).map_or(f64::NAN, |(_, p)| *p)
    }

    fn at_distance(&self) -> String {
        self.weights.nonzero().next().map(|(_, count)| count.to_string()).unwrap_or_default()
    }
}

/// All judged codes.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// The codes by length, then in the order of [`codes::POLYNOMIALS`].
    pub codes: Vec<Judged>,
}

impl Analysis {
    /// Calculates the results for the codes whose duals have these weights.
    ///
    /// # Errors
    ///
    /// [`NotADual`], with the code, if the weights counted for a code are not those of any dual.
    pub fn new(duals: &[(Code, DualWeights)]) -> Result<Self, (Code, NotADual)> {
        let codes = duals.iter().map(|(code, dual)| {
            let weights = Weights::from_dual(dual, code.named.polynomial.degree()).map_err(|error| (*code, error))?;
            let undetected = BitErrorRate::tabulated().map(|rate| (rate, undetected_exactly(&weights, rate))).collect();
            Ok(Judged { code: *code, curve: ErrorCurve::new(&weights), weights, undetected })
        });
        Ok(Self { codes: codes.collect::<Result<_, _>>()? })
    }

    /// Calculates the results for all codes from the committed weights of their duals.
    ///
    /// # Errors
    ///
    /// The errors are those of [`Analysis::new`].
    pub fn committed() -> Result<Self, (Code, NotADual)> {
        let duals: Vec<(Code, DualWeights)> =
            Code::all().into_iter().filter_map(|code| Some((code, code.committed()?))).collect();
        Self::new(&duals)
    }

    /// Returns the results for this code, which must be one of [`Analysis::codes`].
    ///
    /// # Panics
    ///
    /// Panics if the code is not one of [`Analysis::codes`].
    #[must_use]
    pub fn code(&self, named: Named, bits: usize) -> &Judged {
        let wanted = Code { named, bits };
        self.codes.iter().find(|judged| judged.code == wanted).unwrap_or_else(|| panic!("{wanted:?} was not judged"))
    }

    /// The objects of the profile with `receivers` receivers.
    #[must_use]
    pub fn profile(&self, receivers: usize) -> ProfileCurves<'_> {
        ProfileCurves {
            reported: &self.code(FRAME, codes::REPORTED_BITS).curve,
            gps: &self.code(FRAME, codes::GPS_BITS).curve,
            receivers,
        }
    }

    /// The plot of all codes' error curves, as an SVG document.
    ///
    /// # Errors
    ///
    /// The errors are those of [`plot::svg`](crate::plot::svg).
    pub fn svg(&self) -> Result<String, Box<dyn std::error::Error>> {
        let curves: Vec<(Code, ErrorCurve)> =
            self.codes.iter().map(|judged| (judged.code, judged.curve.clone())).collect();
        crate::plot::svg(&curves)
    }
}

/// A claim about the CRCs, and whether it holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Claim {
    /// The claim's text.
    pub claim: String,
    /// Whether the claim holds.
    pub holds: bool,
    /// The number that shows why the claim holds or fails.
    pub figure: String,
}

/// The results of `cargo xtask residual`.
#[derive(Clone, Debug)]
pub struct Report {
    /// The judged codes.
    pub analysis: Analysis,
    /// The distance of both CRCs together, for errors in latitude and longitude.
    pub joint: Joint,
    /// The verdicts of `profile` on objects with injected errors.
    pub checks: Vec<Check>,
}

impl Report {
    /// Adds the searches and the injections to the results of the codes, which takes less than a minute.
    #[must_use]
    pub fn new(analysis: Analysis, threads: NonZero<usize>) -> Self {
        let joint = Joint::search(&Nesting::REPORTED_POSITION, threads);
        let checks = wire::check(&joint, threads);
        Self { analysis, joint, checks }
    }

    /// The injections with another outcome than the theory's. There must be none.
    pub fn unexplained(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|check| !check.holds())
    }

    /// The claims of the paper and of this report.
    #[must_use]
    pub fn claims(&self) -> Vec<Claim> {
        let mut claims = Vec::new();
        let mut add = |claim: String, holds: bool, figure: String| claims.push(Claim { claim, holds, figure });
        let analysis = &self.analysis;

        let mut distance = |claim: &str, named: Named, bits: usize, claimed: usize| {
            let judged = analysis.code(named, bits);
            let hd = judged.weights.hamming_distance();
            add(
                claim.to_owned(),
                hd >= claimed,
                format!("Hamming distance {hd} at {bits} bits, {} codewords of that weight", judged.at_distance()),
            );
        };
        distance(
            "paper: the frame CRC protects 448 bits of payload to a Hamming distance of 8",
            FRAME,
            codes::GPS_BITS,
            8,
        );
        distance(
            "the same for the 480 bits that Reported-Position has by the paper's Table 2",
            FRAME,
            codes::REPORTED_BITS,
            8,
        );
        distance(
            "paper: the position CRC protects latitude and longitude to a Hamming distance of 9",
            POSITION,
            codes::POSITION_BITS,
            9,
        );

        let conventional = BitErrorRate::CONVENTIONAL.value();
        for receivers in rate::RECEIVERS {
            let profile = analysis.profile(receivers);
            let up_to = profile
                .holds_up_to(1e-9)
                .map_or("any bit error rate".to_owned(), |p| format!("a bit error rate of {p:.2e}"));
            for p in [conventional, 1e-3, 1e-4] {
                let rate = profile.residual_per_hour(p);
                add(
                    format!(
                        "paper: better than one failure in 100 000 years (1e-9 per hour), n = {receivers}, bit error \
                         rate {p:.0e}"
                    ),
                    rate < 1e-9,
                    format!("{rate:.2e} per hour; holds up to {up_to}"),
                );
            }
        }
        let three = analysis.profile(3);
        let rate_at = |p: f64| three.residual_per_hour(p);
        let literal = 1e-8;
        let up_to = |limit: f64| three.holds_up_to(limit).map_or("0.5".to_owned(), |p| format!("{p:.2e}"));
        add(
            "paper, its 10e-9 taken as printed: below 1e-8 per hour, n = 3, bit error rate 1e-2".to_owned(),
            rate_at(conventional) < literal,
            format!("{:.2e} per hour; holds up to a bit error rate of {}", rate_at(conventional), up_to(literal)),
        );
        let century = literal / (100_000.0 * HOURS_PER_YEAR);
        add(
            "paper, taken as a probability of 10e-9 of any failure in 100 000 years, n = 3, bit error rate 1e-4"
                .to_owned(),
            rate_at(1e-4) < century,
            format!(
                "{:.2e} per hour against {century:.2e}; holds up to a bit error rate of {}",
                rate_at(1e-4),
                up_to(century)
            ),
        );

        for sil in Sil::ALL {
            let rate = rate_at(conventional);
            add(
                format!("SIL {}, 1 % rule, bit error rate 1e-2, n = 3, no error interval limit", sil.number()),
                rate < sil.channel_limit(),
                format!(
                    "{rate:.2e} per hour against {:.0e}; holds up to a bit error rate of {}",
                    sil.channel_limit(),
                    up_to(sil.channel_limit())
                ),
            );
        }
        for sil in Sil::ALL {
            let limited = analysis.profile(5).residual_per_hour_limited(f64::from(sil.error_interval_minutes()));
            add(
                format!(
                    "SIL {}, 1 % rule, any bit error rate, any n, one rejected object in {} minutes at most",
                    sil.number(),
                    sil.error_interval_minutes()
                ),
                limited < sil.channel_limit(),
                format!("{limited:.2e} per hour against {:.0e}", sil.channel_limit()),
            );
        }
        for (what, named, bits) in [
            ("frame CRC, GPS object", FRAME, codes::GPS_BITS),
            ("frame CRC, Reported-Position", FRAME, codes::REPORTED_BITS),
            ("position CRC, latitude and longitude", POSITION, codes::POSITION_BITS),
        ] {
            let worst = analysis.code(named, bits).curve.conditional_maximum();
            add(
                format!("{what}: P_re,cond at most 4.0e-10 (OPC UA Safety) at any bit error rate from 1e-6 to 0.5"),
                worst.value <= rate::OPC_UA_SAFETY_CONDITIONAL,
                format!("{:.4e}, reached at a bit error rate of {:.2e}", worst.value, worst.bit_error_rate),
            );
        }
        let joint = &self.joint;
        add(
            "errors that damage latitude or longitude, or anything else besides, and pass both CRCs: at least 12"
                .to_owned(),
            joint.at_least >= 12,
            match joint.distance {
                Some(distance) => format!("distance {distance} exactly"),
                None => format!("distance {} at least", joint.at_least),
            },
        );
        let common = FRAME.polynomial.common_degree(POSITION.polynomial);
        add(
            "every burst of up to 64 bits inside latitude, longitude and their CRC is detected".to_owned(),
            common == 0,
            format!("the polynomials have a common factor of degree {common}"),
        );
        claims
    }

    /// The report's tables, each with its name, in Markdown.
    #[must_use]
    pub fn tables(&self) -> Vec<(&'static str, String)> {
        vec![
            ("claims", self.claims_table()),
            ("codes", self.codes_table()),
            ("undetected", self.undetected_table()),
            ("comparison", self.comparison_table()),
            ("rates", self.rates_table()),
            ("limits", self.limits_table()),
            ("interval", self.interval_table()),
            ("bursts", bursts_table()),
            ("joint", self.joint_table()),
            ("checks", self.checks_table()),
        ]
    }

    fn claims_table(&self) -> String {
        let rows = self
            .claims()
            .into_iter()
            .map(|claim| vec![claim.claim, if claim.holds { "yes" } else { "**no**" }.to_owned(), claim.figure]);
        table(&["claim", "holds", "figure"], rows)
    }

    fn codes_table(&self) -> String {
        let rows = codes::POLYNOMIALS.map(|named| {
            let mut row = vec![
                named.name.to_owned(),
                format!("{}", named.polynomial),
                format!("{:#010x}", named.polynomial.normal()),
                yes(named.polynomial.is_even()),
            ];
            row.extend(codes::COMPARED.map(|bits| {
                let judged = self.analysis.code(named, bits);
                format!("{} ({})", judged.weights.hamming_distance(), judged.at_distance())
            }));
            row
        });
        table(
            &["polynomial", "Koopman", "normal", "x + 1 divides", "160 bits", "480 bits", "512 bits"],
            rows.into_iter(),
        )
    }

    fn undetected_table(&self) -> String {
        let columns = [(FRAME, codes::GPS_BITS), (FRAME, codes::REPORTED_BITS), (POSITION, codes::POSITION_BITS)];
        let rows = BitErrorRate::tabulated().map(|rate| {
            let mut row = vec![rate.to_string()];
            row.extend(
                columns
                    .iter()
                    .map(|(named, bits)| format!("{:.3e}", self.analysis.code(*named, *bits).undetected_at(rate))),
            );
            row
        });
        let mut rows: Vec<Vec<String>> = rows.collect();
        type Of = fn(&ErrorCurve) -> crate::Maximum;
        for (name, of) in
            [("largest", ErrorCurve::maximum as Of), ("largest P_re,cond", ErrorCurve::conditional_maximum)]
        {
            let mut row = vec![name.to_owned()];
            row.extend(columns.iter().map(|(named, bits)| {
                let maximum = of(&self.analysis.code(*named, *bits).curve);
                format!("{:.4e} from {:.2e}", maximum.value, maximum.bit_error_rate)
            }));
            rows.push(row);
        }
        table(
            &["bit error rate", "frame, GPS object", "frame, Reported-Position", "position, latitude and longitude"],
            rows.into_iter(),
        )
    }

    fn comparison_table(&self) -> String {
        let rows = codes::COMPARED.into_iter().flat_map(|bits| {
            codes::POLYNOMIALS.map(|named| {
                let judged = self.analysis.code(named, bits);
                let (largest, conditional) = (judged.curve.maximum(), judged.curve.conditional_maximum());
                let mut row =
                    vec![bits.to_string(), named.name.to_owned(), judged.weights.hamming_distance().to_string()];
                row.extend(
                    [4, 3, 2].map(|decade| format!("{:.2e}", judged.undetected_at(BitErrorRate { digit: 1, decade }))),
                );
                row.push(format!("{:.3e}", largest.value));
                row.push(format!("{:.3e}", conditional.value));
                row.push(yes(conditional.value <= rate::OPC_UA_SAFETY_CONDITIONAL));
                row
            })
        });
        table(
            &[
                "bits",
                "polynomial",
                "distance",
                "P_ud at 1e-4",
                "at 1e-3",
                "at 1e-2",
                "largest P_ud",
                "largest P_re,cond",
                "≤ 4.0e-10",
            ],
            rows,
        )
    }

    fn rates_table(&self) -> String {
        let rates = [(1, 6), (1, 5), (1, 4), (5, 4), (1, 3), (2, 3), (5, 3), (1, 2), (1, 1), (5, 1)];
        let rows =
            rates.map(|(digit, decade)| {
                let rate = BitErrorRate { digit, decade };
                let mut row = vec![rate.to_string()];
                row.extend(rate::RECEIVERS.map(|receivers| {
                    format!("{:.2e}", self.analysis.profile(receivers).residual_per_hour(rate.value()))
                }));
                row.push(format!("{:.2e}", self.analysis.profile(3).rejected_per_hour(rate.value())));
                row
            });
        table(&["bit error rate", "n = 1", "n = 2", "n = 3", "n = 5", "rejected per hour, n = 3"], rows.into_iter())
    }

    fn limits_table(&self) -> String {
        let rows = Sil::ALL.map(|sil| {
            let mut row = vec![format!("SIL {}", sil.number()), format!("{:.0e}", sil.channel_limit())];
            row.extend(rate::RECEIVERS.map(|receivers| {
                self.analysis
                    .profile(receivers)
                    .holds_up_to(sil.channel_limit())
                    .map_or("any".to_owned(), |p| format!("{p:.2e}"))
            }));
            row
        });
        table(&["level", "residual errors per hour", "n = 1", "n = 2", "n = 3", "n = 5"], rows.into_iter())
    }

    fn interval_table(&self) -> String {
        let rows = Sil::ALL.map(|sil| {
            let minutes = f64::from(sil.error_interval_minutes());
            let profile = self.analysis.profile(3);
            let limited = profile.residual_per_hour_limited(minutes);
            vec![
                format!("{} min", sil.error_interval_minutes()),
                format!("{limited:.2e}"),
                format!("SIL {}: {:.0e}", sil.number(), sil.channel_limit()),
                yes(limited < sil.channel_limit()),
                profile.one_rejected_per(minutes).map_or("any".to_owned(), |p| format!("{p:.2e}")),
            ]
        });
        table(
            &[
                "at most one rejected object in",
                "residual errors per hour, any bit error rate",
                "limit",
                "met",
                "bit error rate of one rejected per interval, n = 3",
            ],
            rows.into_iter(),
        )
    }

    fn joint_table(&self) -> String {
        let rows = self.joint.examined.iter().map(|examined| {
            vec![
                (examined.inside + examined.outside).to_string(),
                examined.inside.to_string(),
                examined.outside.to_string(),
                examined.candidates.to_string(),
                examined.words.to_string(),
            ]
        });
        table(&["errors", "in bytes 8 to 27", "elsewhere", "position codewords looked up", "pass both CRCs"], rows)
    }

    fn checks_table(&self) -> String {
        let rows = self.checks.iter().map(|check| {
            let expected = match check.expected {
                Expected::Rejected => "none",
                Expected::Accepted => "all",
                Expected::Improbable => "hardly any",
            };
            vec![
                check.object.to_owned(),
                check.patterns.clone(),
                check.injected.tried.to_string(),
                expected.to_owned(),
                (check.injected.accepted + check.injected.identifier).to_string(),
                check.injected.identifier.to_string(),
            ]
        });
        table(
            &[
                "object",
                "patterns",
                "injected",
                "must pass the CRCs",
                "passed the CRCs",
                "of these rejected for the identifier",
            ],
            rows,
        )
    }

    /// Returns the text of the report's page with updated tables: each is between `<!-- table: NAME -->` and `<!-- end
    /// -->`.
    ///
    /// # Errors
    ///
    /// Returns a message that names the table for which the text has no place.
    pub fn refresh(&self, text: &str) -> Result<String, String> {
        self.tables().into_iter().try_fold(text.to_owned(), |text, (name, table)| {
            let begin = format!("<!-- table: {name} -->\n");
            let place = || format!("{REPORT_PATH} has no place for the table `{name}`");
            let (before, rest) = text.split_once(&begin).ok_or_else(place)?;
            let (_, after) = rest.split_once("<!-- end -->").ok_or_else(place)?;
            Ok(format!("{before}{begin}{table}<!-- end -->{after}"))
        })
    }

    /// A summary of the results that fits on one screen.
    #[must_use]
    pub fn screen(&self) -> String {
        let mut text = String::new();
        for (title, table) in [
            ("Codes: Hamming distance (codewords of that weight)", self.codes_table()),
            ("Residual errors per hour", self.rates_table()),
        ] {
            let _ = writeln!(text, "{title}\n\n{table}");
        }
        text.push_str("Injected into sealed objects\n\n");
        for check in &self.checks {
            let passed = check.injected.accepted + check.injected.identifier;
            let verdict = if check.holds() { "as expected" } else { "NOT AS EXPECTED" };
            let _ = writeln!(
                text,
                "  {}: {}: {passed} of {} passed the CRCs, {verdict}",
                check.object, check.patterns, check.injected.tried
            );
        }
        text.push_str("\nClaims\n\n");
        for claim in self.claims() {
            let _ = writeln!(
                text,
                "  {:<5} {}\n        {}",
                if claim.holds { "holds" } else { "FAILS" },
                claim.claim,
                claim.figure
            );
        }
        text
    }
}

fn yes(holds: bool) -> String {
    if holds { "yes" } else { "no" }.to_owned()
}

fn bursts_table() -> String {
    let row = |bits: &str, length: u32| {
        let undetected = burst::undetected_log2(32, length).map_or(("none".to_owned(), "0".to_owned()), |log2| {
            (format!("1 of 2^{}", -log2), format!("{:.3e}", 2_f64.powi(log2 as i32)))
        });
        vec![bits.to_owned(), undetected.0, undetected.1]
    };
    table(
        &["burst, bits", "undetected", "part"],
        [row("1 to 32", 32), row("33", 33), row("34 and more", 34)].into_iter(),
    )
}

fn table(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut text = format!("| {} |\n|{}\n", head.join(" | "), "---|".repeat(head.len()));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text
}

#[derive(Serialize)]
struct CodeJson {
    polynomial_koopman: String,
    polynomial_normal: String,
    name: &'static str,
    codeword_bits: usize,
    check_bits: u32,
    hd: usize,
    #[serde(serialize_with = "in_order")]
    weights: Vec<(String, String)>,
    #[serde(serialize_with = "in_order")]
    p_undetected: Vec<(String, f64)>,
    p_undetected_max: MaximumJson,
    p_re_cond_max: MaximumJson,
}

#[derive(Serialize)]
struct MaximumJson {
    bit_error_rate: f64,
    value: f64,
}

impl From<crate::Maximum> for MaximumJson {
    fn from(maximum: crate::Maximum) -> Self {
        Self { bit_error_rate: maximum.bit_error_rate, value: maximum.value }
    }
}

#[derive(Serialize)]
struct ProfileJson {
    receivers: usize,
    #[serde(serialize_with = "in_order")]
    residual_errors_per_hour: Vec<(String, f64)>,
    #[serde(serialize_with = "in_order")]
    rejected_objects_per_hour: Vec<(String, f64)>,
    #[serde(serialize_with = "in_order")]
    holds_up_to_bit_error_rate: Vec<(String, Option<f64>)>,
    #[serde(serialize_with = "in_order")]
    residual_errors_per_hour_with_error_interval_limit_minutes: Vec<(String, f64)>,
}

#[derive(Serialize)]
struct JointJson {
    inner_koopman: String,
    outer_koopman: String,
    distance: Option<usize>,
    distance_at_least: usize,
    examined: Vec<ExaminedJson>,
}

#[derive(Serialize)]
struct ExaminedJson {
    errors_inside: usize,
    errors_outside: usize,
    candidates: u64,
    codewords: u64,
}

#[derive(Serialize)]
struct CheckJson {
    object: &'static str,
    patterns: String,
    injected: u64,
    passed_the_crcs: u64,
    rejected_for_the_identifier: u64,
    as_expected: bool,
}

#[derive(Serialize)]
struct BurstJson {
    bits: &'static str,
    undetected_log2: Option<i64>,
}

#[derive(Serialize)]
struct ReportJson {
    codes: Vec<CodeJson>,
    profiles: Vec<ProfileJson>,
    bursts: Vec<BurstJson>,
    latitude_longitude: JointJson,
    injected: Vec<CheckJson>,
    claims: Vec<Claim>,
}

fn in_order<S: Serializer, T: Serialize>(pairs: &[(String, T)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().map(|(key, value)| (key, value)))
}

impl Serialize for Report {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let codes = self.analysis.codes.iter().map(|judged| CodeJson {
            polynomial_koopman: judged.code.named.polynomial.to_string(),
            polynomial_normal: format!("{:#010x}", judged.code.named.polynomial.normal()),
            name: judged.code.named.name,
            codeword_bits: judged.code.bits,
            check_bits: judged.weights.check_bits(),
            hd: judged.weights.hamming_distance(),
            weights: judged.weights.nonzero().map(|(weight, count)| (weight.to_string(), count.to_string())).collect(),
            p_undetected: judged.undetected.iter().map(|(rate, p)| (rate.to_string(), *p)).collect(),
            p_undetected_max: judged.curve.maximum().into(),
            p_re_cond_max: judged.curve.conditional_maximum().into(),
        });
        let profiles = rate::RECEIVERS.map(|receivers| {
            let profile = self.analysis.profile(receivers);
            let over = |function: &dyn Fn(f64) -> f64| {
                BitErrorRate::tabulated().map(|rate| (rate.to_string(), function(rate.value()))).collect()
            };
            ProfileJson {
                receivers,
                residual_errors_per_hour: over(&|p| profile.residual_per_hour(p)),
                rejected_objects_per_hour: over(&|p| profile.rejected_per_hour(p)),
                holds_up_to_bit_error_rate: Sil::ALL
                    .map(|sil| (format!("SIL {}", sil.number()), profile.holds_up_to(sil.channel_limit())))
                    .to_vec(),
                residual_errors_per_hour_with_error_interval_limit_minutes: Sil::ALL
                    .map(|sil| {
                        (
                            sil.error_interval_minutes().to_string(),
                            profile.residual_per_hour_limited(f64::from(sil.error_interval_minutes())),
                        )
                    })
                    .to_vec(),
            }
        });
        let nesting = Nesting::REPORTED_POSITION;
        ReportJson {
            codes: codes.collect(),
            profiles: profiles.into_iter().collect(),
            bursts: [("1..32", 32), ("33", 33), ("34..", 34)]
                .map(|(bits, length)| BurstJson { bits, undetected_log2: burst::undetected_log2(32, length) })
                .into(),
            latitude_longitude: JointJson {
                inner_koopman: nesting.inner.to_string(),
                outer_koopman: nesting.outer.to_string(),
                distance: self.joint.distance,
                distance_at_least: self.joint.at_least,
                examined: self
                    .joint
                    .examined
                    .iter()
                    .map(|examined| ExaminedJson {
                        errors_inside: examined.inside,
                        errors_outside: examined.outside,
                        candidates: examined.candidates,
                        codewords: examined.words,
                    })
                    .collect(),
            },
            injected: self
                .checks
                .iter()
                .map(|check| CheckJson {
                    object: check.object,
                    patterns: check.patterns.clone(),
                    injected: check.injected.tried,
                    passed_the_crcs: check.injected.accepted + check.injected.identifier,
                    rejected_for_the_identifier: check.injected.identifier,
                    as_expected: check.holds(),
                })
                .collect(),
            claims: self.claims(),
        }
        .serialize(serializer)
    }
}
