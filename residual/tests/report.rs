//! Tests the results of `cargo xtask residual` from the committed weights: all injections, the claims, the report's
//! page and its JSON.
use std::num::NonZero;
use std::path::Path;
use std::sync::LazyLock;

use residual::codes::{self, COMPARED, FRAME, POLYNOMIALS, POSITION};
use residual::report::{Analysis, PLOT_PATH, REPORT_PATH, Report};
use residual::wire::{self, Check, Expected, Injected, Object};
use residual::{BitErrorRate, Code, DualWeights};

/// Making the report takes half a minute, so all tests share one report.
static REPORT: LazyLock<Report> =
    LazyLock::new(|| Report::new(Analysis::committed().unwrap(), NonZero::new(2).unwrap()));

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

fn check(object: Object, patterns: &str) -> &'static Check {
    REPORT.checks.iter().find(|check| check.object == object.name() && check.patterns == patterns).unwrap()
}

#[test]
fn one_two_and_three_wrong_bits_are_always_rejected() {
    for object in Object::ALL {
        let n = object.bits() as u64;
        for (errors, tried) in [(1, n), (2, n * (n - 1) / 2), (3, n * (n - 1) * (n - 2) / 6)] {
            let check = check(object, &format!("every pattern of {errors} wrong bits"));
            assert_eq!(check.injected, Injected { tried, accepted: 0, identifier: 0 }, "{}, {errors}", object.name());
        }
    }
}

#[test]
fn bursts_of_up_to_16_bits_are_always_rejected() {
    for object in Object::ALL {
        // There are n positions for a burst of 1 bit, and n - b + 1 positions for each of the 2^(b - 2) bursts of b
        // bits.
        let n = object.bits() as u64;
        let tried = n + (2..=16).map(|b| (n - b + 1) << (b - 2)).sum::<u64>();
        let check = check(object, "every burst of 1 to 16 bits");
        assert_eq!(check.injected, Injected { tried, accepted: 0, identifier: 0 }, "{}", object.name());
    }
}

#[test]
fn what_profile_makes_of_every_injection_is_what_the_theory_says() {
    assert_eq!(REPORT.unexplained().count(), 0);
    for expected in [Expected::Rejected, Expected::Accepted, Expected::Improbable] {
        assert!(REPORT.checks.iter().any(|check| check.expected == expected));
    }
}

#[test]
fn an_injection_against_the_theory_is_reported() {
    let injected = |tried, accepted| Injected { tried, accepted, identifier: 0 };
    let check = |expected, injected| Check { object: "GPS1", patterns: String::new(), expected, injected };
    assert!(!check(Expected::Rejected, injected(100, 1)).holds());
    assert!(!check(Expected::Rejected, injected(0, 0)).holds(), "nothing was tried");
    assert!(!check(Expected::Accepted, injected(100, 99)).holds());
    assert!(!check(Expected::Accepted, injected(0, 0)).holds());
    assert!(!check(Expected::Improbable, injected(100, 2)).holds());
    assert!(
        check(Expected::Rejected, injected(100, 0)).holds() && check(Expected::Accepted, injected(100, 100)).holds()
    );
}

#[test]
fn no_errors_below_12_damage_latitude_or_longitude_and_pass_both_crcs() {
    let joint = &REPORT.joint;
    assert_eq!((joint.distance, joint.at_least), (Some(12), 12));
    assert!(!joint.words.is_empty());
    assert!(joint.words.iter().all(|word| word.len() == 12 && wire::touches(word, codes::REPORTED_BITS, 8..24)));
    // The number of inner codewords that the search has tested must be the number that follows from the dual.
    let weights = Code { named: POSITION, bits: codes::POSITION_BITS }.weights().unwrap();
    for examined in &joint.examined {
        assert_eq!(weights.counts()[examined.inside], examined.candidates.into());
        assert_eq!(examined.words == 0, examined.inside + examined.outside < 12);
    }
}

#[test]
fn every_compared_code_is_in_the_json_by_length() {
    let text = serde_json::to_string(&*REPORT).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let codes = json["codes"].as_array().unwrap();
    let lengths: Vec<u64> = codes.iter().map(|code| code["codeword_bits"].as_u64().unwrap()).collect();
    assert!(lengths.is_sorted());
    for bits in COMPARED {
        for named in POLYNOMIALS {
            let code = codes
                .iter()
                .find(|code| {
                    code["polynomial_koopman"] == named.polynomial.to_string() && code["codeword_bits"] == bits
                })
                .unwrap();
            let weights = code["weights"].as_object().unwrap();
            let least = weights.keys().map(|weight| weight.parse::<u64>().unwrap()).min();
            assert_eq!(code["hd"].as_u64(), least);
            assert!(
                weights
                    .values()
                    .all(|count| count.as_str().is_some_and(|count| count.bytes().all(|digit| digit.is_ascii_digit())))
            );
            for rate in BitErrorRate::tabulated() {
                let p = code["p_undetected"][rate.to_string()].as_f64().unwrap();
                assert!(p > 0.0 && p < 1e-3, "{} at {bits} bits, {rate}: {p}", named.name);
            }
        }
    }
    // A JSON object keeps the order of its entries, so the first weight is the distance.
    assert!(text.contains(r#""codeword_bits":480,"check_bits":32,"hd":8,"weights":{"8":"31604382","#));
    for claim in json["claims"].as_array().unwrap() {
        assert!(claim["claim"].is_string() && claim["holds"].is_boolean() && claim["figure"].is_string());
    }
}

// Shows OBJ-11.
#[test]
fn the_papers_claims_hold_except_the_failure_rate_at_1e_2() {
    let claims = REPORT.claims();
    let holds =
        |part: &str| claims.iter().find(|claim| claim.claim.contains(part)).unwrap_or_else(|| panic!("{part}")).holds;
    assert!(holds("448 bits of payload to a Hamming distance of 8"));
    assert!(holds("longitude to a Hamming distance of 9"));
    assert!(!holds("n = 3, bit error rate 1e-2"));
    assert!(holds("n = 3, bit error rate 1e-3"));
    assert!(holds("P_re,cond at most 4.0e-10"));
    // These values were calculated by hand: there are 31 604 382 words of weight 8 in 480 bits, and 53 157 895 in 512.
    // At 1e-5 the next weights add less than a part in 10 000.
    let p = 1e-5_f64;
    let expected =
        360_000.0 * p.powi(8) * (53_157_895.0 * (1.0 - p).powi(504) + 3.0 * 31_604_382.0 * (1.0 - p).powi(472));
    let rate = REPORT.analysis.profile(3).residual_per_hour(p);
    assert!((rate / expected - 1.0).abs() < 1e-4, "{rate:e}, {expected:e}");
}

#[test]
fn the_page_and_its_plot_are_what_the_command_writes() {
    let page = std::fs::read_to_string(root().join(REPORT_PATH)).unwrap();
    assert!(
        REPORT.refresh(&page).unwrap() == page,
        "{REPORT_PATH} is out of date: run `cargo xtask residual --committed`"
    );
    let plot = std::fs::read_to_string(root().join(PLOT_PATH)).unwrap();
    assert!(
        REPORT.analysis.svg().unwrap() == plot,
        "{PLOT_PATH} is out of date: run `cargo xtask residual --committed`"
    );
}

#[test]
fn a_page_without_a_tables_place_is_refused() {
    assert!(REPORT.refresh("# Residual error\n").unwrap_err().contains("no place for the table"));
}

#[test]
fn weights_of_another_code_are_refused() {
    let code = Code { named: FRAME, bits: codes::GPS_BITS };
    let mut counts = code.committed().unwrap().counts().to_vec();
    counts[240] -= 1;
    counts[242] += 1;
    let refused = Analysis::new(&[(code, DualWeights::from_counts(counts))]);
    assert_eq!(refused.err().map(|(code, _)| code), Some(code));
}
