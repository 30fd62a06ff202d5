//! Depth-first search over every order of events, by running the same deterministic program again and again.
//!
//! A run calls [`Explorer::choose`] wherever more than one event can happen next. The first run always takes the first
//! continuation. Each later run repeats the choices of the previous run up to the last one that has an alternative
//! left, and takes that alternative. Code that is interrupted cannot be copied, so a run is repeated from its start (as
//! in loom). A run ends early at a state that an earlier run has met. States are compared by digests of 64 bits; the
//! probability that any two of half a million states share a digest is 1 in 10^8.

use std::{
    any::Any,
    cell::RefCell,
    collections::HashSet,
    fmt,
    hash::{DefaultHasher, Hash, Hasher},
    panic::{catch_unwind, resume_unwind, AssertUnwindSafe},
};

/// The most choices of one run. A model that exceeds this number never ends.
const DEPTH: usize = 10_000;
/// The most states of one search. A search with more of them has bounds that are too wide for a test.
const STATES: usize = 1_500_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Explored {
    /// The number of different states in which more than one event could happen next.
    pub(crate) states: usize,
    /// The number of runs, both those that ended and those that met a known state.
    pub(crate) runs: usize,
}

pub(crate) struct Counterexample {
    pub(crate) broken: String,
    pub(crate) trace: Vec<String>,
}

impl fmt::Debug for Counterexample {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, after:\n  {}", self.broken, self.trace.join("\n  "))
    }
}

/// The panic payload that ends a run which met a known state.
struct Known;
/// The panic payload that ends a run which broke a rule; it names the rule.
struct Broken(String);

#[derive(Default)]
pub(crate) struct Explorer {
    search: RefCell<Search>,
}

#[derive(Default)]
struct Search {
    /// The choices of this run: for each, the number of the continuation that was taken, and how many there were.
    path: Vec<(usize, usize)>,
    /// The number of choices at the start of `path` that this run has repeated so far.
    made: usize,
    seen: HashSet<u64>,
    /// The digests of this run in their order.
    digests: Vec<u64>,
    asked: usize,
    trace: Vec<&'static str>,
}

impl Explorer {
    /// Chooses one of `of` continuations, numbered from 0. `state` digests everything on which the future depends.
    pub(crate) fn choose(&self, of: usize, state: impl FnOnce() -> u64) -> usize {
        if of == 1 {
            return 0;
        }
        let mut search = self.search.borrow_mut();
        let made = search.made;
        search.made += 1;
        if let Some(&(taken, before)) = search.path.get(made) {
            assert_eq!(of, before, "the model is not deterministic");
            return taken;
        }
        assert!(made < DEPTH, "the model does not end");
        assert!(search.seen.len() < STATES, "more states than the bounds allow for");
        if !search.seen.insert(state()) {
            drop(search);
            resume_unwind(Box::new(Known));
        }
        search.path.push((0, of));
        0
    }

    /// Returns the digest that `compute` gives, or that of the previous run while this run repeats it.
    pub(crate) fn remember(&self, compute: impl FnOnce() -> u64) -> u64 {
        let mut search = self.search.borrow_mut();
        let asked = search.asked;
        search.asked += 1;
        // Before its last choice, this run is the same as the previous one. So every digest from before that choice is
        // taken from the previous run.
        if search.made < search.path.len() {
            if let Some(&known) = search.digests.get(asked) {
                return known;
            }
        }
        let digest = compute();
        search.digests.truncate(asked);
        search.digests.push(digest);
        digest
    }

    pub(crate) fn note(&self, what: &'static str) {
        self.search.borrow_mut().trace.push(what);
    }

    pub(crate) fn explore(model: impl Fn(std::rc::Rc<Self>)) -> Result<Explored, Counterexample> {
        let explorer = std::rc::Rc::new(Self::default());
        let mut runs = 0;
        loop {
            runs += 1;
            let ended = catch_unwind(AssertUnwindSafe(|| model(explorer.clone())));
            let mut search = explorer.search.borrow_mut();
            if let Err(why) = ended {
                if !why.is::<Known>() {
                    let trace = search.trace.iter().map(ToString::to_string).collect();
                    return Err(Counterexample { broken: what_broke(why), trace });
                }
            }
            search.made = 0;
            search.asked = 0;
            search.trace.clear();
            loop {
                match search.path.last_mut() {
                    None => return Ok(Explored { states: search.seen.len(), runs }),
                    Some((taken, of)) if *taken + 1 < *of => {
                        *taken += 1;
                        break;
                    }
                    Some(_) => {
                        search.path.pop();
                    }
                }
            }
        }
    }
}

pub(crate) fn broken(rule: impl Into<String>) -> ! {
    resume_unwind(Box::new(Broken(rule.into())))
}

pub(crate) fn holds(condition: bool, rule: &str) {
    if !condition {
        broken(rule);
    }
}

/// Returns the rule that was broken, or the text of a panic in the code under test.
fn what_broke(why: Box<dyn Any + Send>) -> String {
    match why.downcast::<Broken>() {
        Ok(broken) => broken.0,
        Err(panic) => match panic.downcast::<String>() {
            Ok(text) => *text,
            Err(panic) => panic.downcast_ref::<&str>().map_or("a panic without a text", |text| text).to_string(),
        },
    }
}

pub(crate) fn digest(of: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    of.hash(&mut hasher);
    hasher.finish()
}

/// Returns a digest of what the derived `Debug` of a value prints, since the value's state is private.
pub(crate) fn digest_shown(of: &impl fmt::Debug) -> u64 {
    struct Into(DefaultHasher);
    impl fmt::Write for Into {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.write(text.as_bytes());
            Ok(())
        }
    }
    let mut into = Into(DefaultHasher::new());
    fmt::Write::write_fmt(&mut into, format_args!("{of:?}")).expect("hashing does not fail");
    into.0.finish()
}
