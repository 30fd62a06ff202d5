use super::*;

/// A trace without a gap that has each kind of evidence once. Each `^` is removed, so that this file itself is no
/// evidence.
struct Small {
    requirements: &'static str,
    sources: Vec<(&'static str, &'static str)>,
    defects: Vec<(&'static str, Option<String>)>,
    mutants: &'static str,
}

const SMALL_REQUIREMENTS: &str = "# Title\n\n| id | requirement | source | reason | weight |\n|---|---|---|---|---|\n\
    | A-1 | One. | design | Why. | safety |\n| A-2 | Two. | paper | Why. | mission |\n\
    | B-1 | Three. | design | Why. | none |\n";
const RULES: &str = "bench/judge/src/violation.rs";
const MUTANTS: &str = "| m | A-2 | a/src/lib.rs | limit | `x < 3` | `x < 4` | `it_ends` |\n\
    | n | B-1 | a/src/lib.rs | LONG | `7` | `8` | constant assertion |\n";

fn small() -> Small {
    Small {
        requirements: SMALL_REQUIREMENTS,
        sources: vec![
            (RULES, "    /// Words.\n    // ^Shows A-1.\n    Late = \"it is late\",\n    Other = \"it is other\",\n"),
            ("a/tests/t.rs", "// ^Shows A-1, A-2.\n#[test]\nfn it_ends() {}\n// ^Shows of words are no evidence.\n"),
            (
                "a/src/lib.rs",
                "const LONG: u8 = 7;\n// ^Shows B-1.\nconst _: () = assert!(LONG == 7);\nfn limit() {\n    x < 3\n}\n",
            ),
            (DEFECTS, "    row(\"d\", \"does\",\n    row(\"e\", \"does\",\n"),
        ],
        defects: vec![("d", Some("Late".to_owned())), ("e", None)],
        mutants: MUTANTS,
    }
}

impl Small {
    fn trace(&self) -> Trace {
        let sources = self.sources.iter().map(|(path, text)| ((*path).to_owned(), text.replace('^', ""))).collect();
        Trace::of(self.requirements, &sources, &self.defects, self.mutants)
    }

    fn with(mut self, path: &str, text: &'static str) -> Self {
        self.sources.iter_mut().filter(|(name, _)| *name == path).for_each(|(_, old)| *old = text);
        self
    }
}

#[test]
fn every_kind_of_evidence_and_of_break_is_in_the_matrix() {
    let trace = small().trace();
    assert_eq!(trace.gaps, [""; 0]);
    assert!(trace.verdict().is_ok());
    let page = trace.page();
    for row in [
        "| A-1 | safety | rule `Late`<br>`it_ends` (a/tests/t.rs) | defect `d` |",
        "| A-2 | mission | `it_ends` (a/tests/t.rs) | mutant `m` |",
        "| B-1 | none | constant assertion (a/src/lib.rs) | mutant `n` |",
    ] {
        assert!(page.contains(row), "{page}");
    }
    let summary = "3 requirements (1 of safety, 1 of the mission, 1 of neither), shown by 1 rules of the judge, 1 \
        tests and 1 constant assertions; broken by 1 defects and 2 mutants.";
    assert!(page.contains(summary) && trace.screen().ends_with(&format!("{summary}\n")), "{page}");
}

#[test]
fn each_gap_fails_and_is_named() {
    let case = |small: Small, gap: &str| {
        let trace = small.trace();
        assert!(trace.gaps.iter().any(|it| it.contains(gap)), "{gap}: {:?}", trace.gaps);
        assert!(trace.verdict().is_err());
    };
    case(small().with("a/tests/t.rs", ""), "nothing shows A-2");
    case(Small { mutants: "", ..small() }, "no defect and no mutant breaks A-2");
    case(Small { defects: vec![], ..small() }, "no defect and no mutant breaks A-1");
    case(
        small().with("a/tests/t.rs", "// ^Shows A-3.\n#[test]\nfn it_ends() {}\n"),
        "a/tests/t.rs shows A-3, which is no",
    );
    case(small().with(DEFECTS, "// ^Breaks C-1.\nrow(\"e\",\n"), "defect `e` breaks C-1, which is no requirement");
    case(small().with(DEFECTS, "// ^Breaks A-2.\nrow(\"d\",\n"), "d breaks `A-2.`, which its rule does not show");
    case(
        small().with(RULES, "// ^Shows A-1, A-2.\nLate = \"it is late\",\n"),
        "d: write above the row which of A-1, A-2",
    );
    case(
        small().with("a/tests/t.rs", "// ^Shows A-2.\nfn it_ends() {}\n"),
        "a/tests/t.rs:1: below `Shows` there is no",
    );
    case(small().with("a/tests/t.rs", "// ^Shows A-2\n#[test]\nfn it_ends() {}\n"), "a/tests/t.rs:1: expected");
    case(Small { requirements: "", ..small() }, "has no requirement");
    case(Small { requirements: "| A-1 | One. | design | Why. | high |\n", ..small() }, "A-1 lacks");
    case(Small { requirements: "| A-1 | One. | design | | none |\n", ..small() }, "A-1 lacks");
    let twice = "| A-1 | One. | design | Why. | none |\n| A-1 | One. | design | Why. | none |\n";
    case(Small { requirements: twice, ..small() }, "A-1 is there twice");
}

#[test]
fn a_mutant_that_fits_no_source_or_no_test_is_a_gap() {
    let case = |row: &'static str, gap: &str| {
        let gaps = Small { mutants: row, ..small() }.trace().gaps;
        assert!(gaps.iter().any(|it| it.contains(gap)), "{gap}: {gaps:?}");
    };
    case(
        "| m | A-2 | a/src/lib.rs | limit | `x < 9` | `x` | `it_ends` |",
        "has to have `x < 9` once, and has it 0 times",
    );
    case("| m | A-2 | a/src/lib.rs | other | `x < 3` | `x` | `it_ends` |", "has it 0 times");
    case("| m | A-2 | a/src/none.rs | limit | `x < 3` | `x` | `it_ends` |", "has it 0 times");
    case("| m | A-2 | a/src/lib.rs | limit | `x < 3` | `x < 3` | `it_ends` |", "changes nothing");
    case("| m | B-1 | a/src/lib.rs | limit | `x < 3` | `x` | `it_ends` |", "`it_ends` does not show B-1");
    case("| m | A-2 | a/src/lib.rs | limit | `x < 3` | `x` | `it_begins` |", "`it_begins` does not show A-2");
}

#[test]
fn a_page_may_cite_requirements_and_other_words_alone() {
    let mut trace = small().trace();
    trace.take_page("page.md", "A-1, CRC-16 and B-1: see IEC-7.");
    assert_eq!(trace.gaps, [""; 0]);
    trace.take_page("page.md", "(A-9)");
    assert_eq!(trace.gaps, ["page.md cites A-9, which is no requirement"]);
}

#[test]
fn a_row_chooses_among_the_requirements_of_its_rule() {
    let mut chosen = small()
        .with(RULES, "// ^Shows A-1, A-2.\nLate = \"it is late\",\n")
        .with(DEFECTS, "// ^Breaks A-1.\nrow(\"d\",\n// ^Breaks B-1.\nrow(\"e\",\n");
    let trace = chosen.trace();
    assert_eq!((trace.gaps, trace.broken["A-1"].clone()), (vec![], vec!["defect `d`".to_owned()]));
    assert_eq!(trace.broken["B-1"], ["defect `e`", "mutant `n`"]);
    assert_eq!(trace.broken["A-2"], ["mutant `m`"]);
    chosen = chosen.with(RULES, "Late = \"it is late\",\n").with(DEFECTS, "row(\"d\",\n");
    assert!(!chosen.trace().broken.contains_key("A-1"), "a rule that shows nothing breaks nothing");
}

#[test]
fn a_mutant_changes_its_item_alone() {
    let text = "const A: u8 = 1;\npub(crate) const fn f(x: u8) -> u8 {\n    x + 1\n}\n\nfn g() {\n    1\n}\n";
    let changed = |item: &str| {
        let row = format!("| m | A-1 | f.rs | {item} | `1` | `a \\| b` | `t` |");
        Mutant::of(&row).unwrap().applied(text).map_err(|error| error.to_string())
    };
    for (item, old, new) in [("A", "= 1;", "= a | b;"), ("f", "x + 1", "x + a | b"), ("g", "    1\n", "    a | b\n")] {
        assert_eq!(changed(item), Ok(text.replace(old, new)), "{item}");
    }
    assert!(changed("h").unwrap_err().contains("0 times"));
}

#[test]
fn the_committed_matrix_is_current_and_has_no_gap() {
    check().unwrap();
}
