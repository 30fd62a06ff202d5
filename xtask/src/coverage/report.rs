//! The coverage of the images in words, and as JSON.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde_json::{Value, json};

use super::gaps::{Count, Counts, Coverage, Gap, Missing, Part};
use super::image::Function;
use super::source::Place;

/// An image with its coverage.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) name: String,
    pub(super) functions: Vec<Function>,
    pub(super) coverage: Coverage,
}

/// Each function with gaps that count, its lines, and what is missing there with the number of instructions. Gaps in
/// libraries have no line.
fn by_function(measured: &Measured) -> BTreeMap<&str, BTreeMap<Option<&Place>, BTreeMap<Missing, usize>>> {
    let mut functions: BTreeMap<_, BTreeMap<_, BTreeMap<_, usize>>> = BTreeMap::new();
    for gap in measured.coverage.gaps.iter().filter(|gap| Part::COUNTED.contains(&gap.part)) {
        let lines = functions.entry(measured.functions[gap.function].name.as_str()).or_default();
        *lines.entry(gap.places.first()).or_default().entry(gap.missing).or_default() += 1;
    }
    functions
}

pub(super) fn text(all: &[Measured]) -> String {
    let mut text = String::new();
    for measured in all {
        let _ = writeln!(text, "{}", measured.name);
        for (function, lines) in by_function(measured) {
            let _ = writeln!(text, "  {function}");
            for (place, missing) in lines {
                let place = place.map_or("library".to_owned(), ToString::to_string);
                let words: Vec<_> =
                    missing.iter().map(|(missing, count)| format!("{count} x {}", missing.words())).collect();
                let _ = writeln!(text, "    {place}: {}", words.join(", "));
            }
        }
    }
    text + "\n" + &table(all)
}

/// The totals of all images, as a table in Markdown.
pub(super) fn table(all: &[Measured]) -> String {
    let mut text =
        "| image | part | instructions | branch outcomes | outcomes in IT blocks |\n|---|---|---|---|---|\n".to_owned();
    for measured in all {
        let coverage = &measured.coverage;
        let mut row = |part: &str, counts: Counts| {
            let [instructions, branches, blocks] = [counts.instructions, counts.branches, counts.blocks].map(cell);
            let _ = writeln!(text, "| {} | {part} | {instructions} | {branches} | {blocks} |", measured.name);
        };
        row("all", coverage.sum(|_| true));
        row("without panics and log", coverage.sum(|part| Part::COUNTED.contains(&part)));
        for part in Part::COUNTED.into_iter().chain([Part::Panic, Part::Log]) {
            row(part.name(), coverage.sum(|other| other == part));
        }
    }
    text
}

fn cell(count: Count) -> String {
    if count.all == 0 { "none".into() } else { format!("{} of {}, {:.1} %", count.seen, count.all, count.percent()) }
}

/// All gaps of all images.
pub(super) fn json(all: &[Measured]) -> Value {
    let gap = |measured: &Measured, gap: &Gap| {
        let places: Vec<String> = gap.places.iter().map(ToString::to_string).collect();
        json!({
            "address": gap.address,
            "function": measured.functions[gap.function].name,
            "part": gap.part.name(),
            "missing": gap.missing.words(),
            "lines": places,
        })
    };
    let image = |measured: &Measured| {
        let gaps: Vec<Value> = measured.coverage.gaps.iter().map(|it| gap(measured, it)).collect();
        json!({ "image": measured.name, "gaps": gaps })
    };
    Value::Array(all.iter().map(image).collect())
}
