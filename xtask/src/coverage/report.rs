//! The coverage of the images in words, and as JSON.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde_json::{Value, json};

use super::explained::{Explained, Gaps, Measured, TABLE};
use super::gaps::{Count, Gap, Missing};
use super::part::Part;
use super::source::Place;

/// Each function with gaps that count, its lines, and what is missing there with the number of instructions. Gaps in
/// libraries have no line.
fn by_function<'a>(
    image: usize,
    measured: &'a Measured,
    explained: &Explained,
) -> BTreeMap<&'a str, BTreeMap<Option<&'a Place>, BTreeMap<Missing, usize>>> {
    let mut functions: BTreeMap<_, BTreeMap<_, BTreeMap<_, usize>>> = BTreeMap::new();
    let is_open =
        |gap: &&Gap| Part::COUNTED.contains(&gap.part) && !explained.gaps.contains(&(image, gap.address, gap.missing));
    for gap in measured.coverage.gaps.iter().filter(is_open) {
        let lines = functions.entry(measured.functions[gap.function].name.as_str()).or_default();
        *lines.entry(gap.places.first()).or_default().entry(gap.missing).or_default() += 1;
    }
    functions
}

/// All gaps that nothing explains.
pub(super) fn text(all: &[Measured], explained: &Explained) -> String {
    let mut text = String::new();
    for (image, measured) in all.iter().enumerate() {
        let _ = writeln!(text, "{}", measured.name);
        for (function, lines) in by_function(image, measured, explained) {
            let _ = writeln!(text, "  {function}");
            for (place, missing) in lines {
                let place = place.map_or("library".to_owned(), ToString::to_string);
                let words: Vec<_> =
                    missing.iter().map(|(missing, count)| format!("{count} x {}", missing.words())).collect();
                let _ = writeln!(text, "    {place}: {}", words.join(", "));
            }
        }
    }
    text
}

/// The totals, what is explained, and what is open.
pub(super) fn summary(all: &[Measured], explained: &Explained) -> String {
    let mut text = table(all, explained);
    text += "\n| image | part | gaps | explained beside the code | explained in the table | open |\n\
             |---|---|---|---|---|---|\n";
    for (image, measured) in all.iter().enumerate() {
        let mut row = |part: &str, gaps: Gaps| {
            let Gaps { all, beside, by_table, .. } = gaps;
            let open = all - beside - by_table;
            let _ = writeln!(text, "| {} | {part} | {all} | {beside} | {by_table} | {open} |", measured.name);
        };
        row("without panics and log", explained.sum(image, |_| true));
        for part in Part::COUNTED {
            row(part.name(), explained.sum(image, |other| other == part));
        }
    }
    let _ = writeln!(text, "\nThe table is `{TABLE}`:\n\n| function or source | gaps | reason |\n|---|---|---|");
    for (reason, count) in &explained.reasons {
        let _ = writeln!(text, "| `{}` | {count} | {} |", reason.code, reason.text);
    }
    text
}

/// The least shares of instructions and branch outcomes that are to be covered without panics and log, per cent.
const TARGETS: [(&str, f64); 2] = [("instructions", 95.0), ("branch outcomes", 90.0)];

/// The number of sources that are named with their gaps.
const NAMED: usize = 20;

/// What is missing to the targets: the shortfall of each image, and the sources with the most open gaps in code that
/// decides or has a deadline.
pub(super) fn missing(all: &[Measured], explained: &Explained) -> String {
    let mut text = String::new();
    for (image, measured) in all.iter().enumerate() {
        let counts = measured.coverage.sum(|part| Part::COUNTED.contains(&part));
        let known = explained.sum(image, |_| true).explained;
        let counts = [(counts.instructions, known.instructions), (counts.branches, known.branches)];
        for ((what, least), (count, known)) in TARGETS.into_iter().zip(counts) {
            let (name, percent, either) = (&measured.name, count.percent(), with(count, known).percent());
            let lacks = if percent < least {
                format!("{:.1} short of {least} %", least - percent)
            } else {
                format!("the target of {least} % is met")
            };
            let _ = writeln!(text, "- {name}: {percent:.1} % of {what}, {lacks}; {either:.1} % covered or explained.");
        }
    }
    let mut sources: BTreeMap<&str, [u64; 2]> = BTreeMap::new();
    for (image, measured) in all.iter().enumerate() {
        let open =
            |gap: &&Gap| gap.part.must_be_explained() && !explained.gaps.contains(&(image, gap.address, gap.missing));
        for gap in measured.coverage.gaps.iter().filter(open) {
            let Some(place) = gap.places.first() else { continue };
            sources.entry(&place.file).or_default()[usize::from(gap.missing != Missing::Execution)] += 1;
        }
    }
    let mut sources: Vec<_> = sources.into_iter().collect();
    sources.sort_by_key(|(file, [code, ways])| (std::cmp::Reverse(code + ways), *file));
    text += "\n| code with open gaps, deciding or in the deadline path | never executed | one way \
             only |\n|---|---|---|\n";
    for (file, [code, ways]) in sources.iter().take(NAMED) {
        let _ = writeln!(text, "| `{file}` | {code} | {ways} |");
    }
    text
}

/// The page for docs/safety.
pub(super) fn page(command: &str, summary: &str, missing: &str) -> String {
    format!(
        "# Object-code coverage\n\n\
         Which instructions of the release images the bench has executed, and which branches went both ways.\n\
         Written by\n\n    \
         {command}\n\n\
         on the fast clock, which also lists each gap by function and source line.\n\
         The runs: `xtask/src/coverage/runs.rs`.\n\
         The suites on the boards are other images and do not count. An instruction leads only to a panic if each path \
         from it\nends in one; those, what formats the log, and functions of libraries that only these call, are \
         counted by themselves.\nA branch has two outcomes, without one that leads only to a panic; so has an \
         instruction in an IT block, which is\nskipped or not. What decides and what has a deadline: \
         `xtask/src/coverage/gaps.rs`.\nCovered is what was executed. Beside it stands what was executed or is \
         explained: by a comment beside the code, or\nfor code of libraries by a table.\n\n## What is missing\n\n\
         {missing}\n## Totals\n\n{summary}"
    )
}

/// The totals of all images, as a table in Markdown.
fn table(all: &[Measured], explained: &Explained) -> String {
    let mut text =
        "| image | part | instructions | or explained | branch outcomes | or explained | outcomes in IT blocks \
                    | or explained |\n|---|---|---|---|---|---|---|---|\n"
            .to_owned();
    for (image, measured) in all.iter().enumerate() {
        let mut row = |name: &str, counted: &dyn Fn(Part) -> bool| {
            let (seen, known) = (measured.coverage.sum(counted), explained.sum(image, counted).explained);
            let pairs =
                [(seen.instructions, known.instructions), (seen.branches, known.branches), (seen.blocks, known.blocks)];
            let cells = pairs.map(|(seen, known)| format!("{} | {}", cell(seen), share(with(seen, known))));
            let _ = writeln!(text, "| {} | {name} | {} |", measured.name, cells.join(" | "));
        };
        row("all", &|_| true);
        row("without panics and log", &|part| Part::COUNTED.contains(&part));
        for part in Part::COUNTED.into_iter().chain([Part::Panic, Part::Log]) {
            row(part.name(), &|other| other == part);
        }
    }
    text
}

/// What is seen or `explained`.
const fn with(count: Count, explained: Count) -> Count {
    Count { seen: count.seen + explained.seen, all: count.all }
}

fn cell(count: Count) -> String {
    if count.all == 0 { "none".into() } else { format!("{} of {}, {}", count.seen, count.all, share(count)) }
}

fn share(count: Count) -> String {
    if count.all == 0 { "none".into() } else { format!("{:.1} %", count.percent()) }
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
            "inlined": gap.inlined,
            "library": gap.library,
        })
    };
    let image = |measured: &Measured| {
        let gaps: Vec<Value> = measured.coverage.gaps.iter().map(|it| gap(measured, it)).collect();
        json!({ "image": measured.name, "gaps": gaps })
    };
    Value::Array(all.iter().map(image).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::gaps::{Counts, Coverage};
    use crate::coverage::image::Function;

    #[test]
    fn a_gap_is_listed_by_function_and_line_until_it_is_explained() {
        let place = Place { file: "dpr-fw/src/link.rs".into(), line: 7 };
        let gap = Gap {
            address: 0x100,
            function: 0,
            part: Part::Deciding,
            missing: Missing::Taken,
            places: vec![place.clone()],
            inlined: vec![],
            library: String::new(),
            lost: Counts::default(),
        };
        let coverage = Coverage { counts: BTreeMap::new(), gaps: vec![gap] };
        let functions = vec![Function { name: "judge".into(), start: 0x100, end: 0x200 }];
        let (lines, executed) = ([place].into(), [].into());
        let all = [Measured { name: "dpr-fw".into(), functions, coverage, lines, executed }];
        let open = text(&all, &Explained::default());
        assert_eq!(open, "dpr-fw\n  judge\n    dpr-fw/src/link.rs:7: 1 x branch never taken\n");
        let explained = Explained { gaps: [(0, 0x100, Missing::Taken)].into(), ..Explained::default() };
        assert_eq!(text(&all, &explained), "dpr-fw\n");
        let lacks = "- dpr-fw: 0.0 % of instructions, 95.0 short of 95 %; 0.0 % covered or explained.";
        let row = "| `dpr-fw/src/link.rs` | 0 | 1 |";
        assert!(missing(&all, &Explained::default()).lines().any(|line| line == lacks));
        assert!(missing(&all, &Explained::default()).contains(row) && !missing(&all, &explained).contains(row));
        assert_eq!(json(&all)[0]["gaps"][0]["lines"][0], "dpr-fw/src/link.rs:7");
    }
}
