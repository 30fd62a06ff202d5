//! What the engine asks of a microcontroller and of the board around it.
//!
//! A [`Part`] is one microcontroller: a rigless [`Mcu`] plus what the engine needs beyond it. A [`Wiring`] is that part
//! with its board: chips on its buses and the wires to its pins. After every access of the firmware and at every stop
//! the engine calls [`Wiring::settle`], where the board carries what its chips drive to the part's pins. The part hears
//! of it at that same instant.

use std::fmt::Debug;
use std::ops::Range;

use rigless::emulator::{Access, CoreSpec};
use rigless::machine::{Board, Target};
use rigless::mcu::Mcu;
use rigless::snapshot::Store;

use super::{FindingKind, Rate};

/// What an access means to program memory whose contents the part's own model does not keep.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FlashAction {
    /// Nothing changes.
    None,
    /// The store's ones leave a bit as it is and its zeros clear it.
    Program,
    /// These addresses read erased from here on.
    Erase(Range<u64>),
}

/// How a part's supply failed before it restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Supply {
    /// It was away: nothing of the time before is left.
    PowerOn,
    /// It fell below the brown-out threshold for a moment: RAM survived, and flags as far as the part keeps them.
    BrownOut,
}

/// One microcontroller, as the engine steps it.
pub trait Part: Mcu + Debug + Send + 'static {
    /// The part's name, as its maker writes it.
    const NAME: &'static str;

    /// How the part's core is made: its variant, interrupt lines, priority bits and where it boots.
    fn core(&self) -> CoreSpec;

    /// What the core runs at now; at zero hertz it stands still and time goes on. The engine asks after every access to
    /// a register and at every stop, so that the core follows the part's clock tree.
    fn rate(&self) -> Rate;

    /// The level of the core's NMI input. While it is high the core takes the exception again and again.
    fn nmi(&self) -> bool {
        false
    }

    /// The restart that comes next is the supply's doing, whatever cause it is given.
    fn supply_failed(&mut self, how: Supply);

    /// The part looks at its own pins at `at` (ns): edges towards its interrupt controller, output pins being watched.
    /// Answers whether anything moved.
    fn settle(&mut self, at: u64) -> bool {
        let _ = at;
        false
    }

    /// What `access` (a store into flash or any access to a register) means to program memory. Only for parts whose
    /// models keep no flash contents.
    fn flash(&mut self, access: &Access) -> FlashAction {
        let _ = access;
        FlashAction::None
    }

    /// Memory that no bus controller but the core reaches, like the STM32F4's CCM RAM.
    fn core_only(&self) -> &'static [Range<u64>] {
        &[]
    }

    /// The core locked up at `at` (ns). Parts whose reset controller hears of it restart; the others hang.
    fn locked_up(&mut self, at: u64) {
        let _ = at;
    }

    /// How many entries [`Part::findings`] has, which the engine asks often.
    fn finding_count(&self) -> usize {
        0
    }

    /// What the part's own models found wrong so far, oldest first, beyond what the engine finds by itself: kind,
    /// instant (ns) and words. The engine reports each once.
    fn findings(&self) -> Vec<(FindingKind, u64, String)> {
        Vec::new()
    }
}

/// A board: one part, the chips on its buses and the wires between them.
pub trait Wiring: Debug + Send + 'static {
    /// The board's microcontroller.
    type Part: Part;

    /// The microcontroller.
    fn part(&self) -> &Self::Part;

    /// The microcontroller, to drive its pins from [`super::Node::input`].
    fn part_mut(&mut self) -> &mut Self::Part;

    /// Carries what the board's chips drive to the part's pins at `at` (ns), and answers whether anything moved. Called
    /// again until nothing does.
    fn settle(&mut self, at: u64) -> bool {
        let _ = at;
        false
    }

    /// When a chip of the board next acts by itself (ns), `u64::MAX` for never. At that instant the engine calls
    /// [`Wiring::settle`], which must move it on. A chip that schedules its events with the part's models needs none of
    /// this.
    fn next_event(&self) -> u64 {
        u64::MAX
    }

    /// Whether something waits to leave the board, which returns [`super::Node::advance`] at once.
    fn outgoing(&self) -> bool {
        false
    }

    /// Sees each of the firmware's accesses to a register with the value read or written.
    fn saw(&mut self, access: &Access, value: u64) {
        let _ = (access, value);
    }
}

/// The rigless board a [`Wiring`] is to its session.
#[derive(Debug)]
pub(crate) struct Carrier<B>(pub(crate) B);

/// A carrier has no snapshots: a run starts from its images and seed alone.
impl<B: Wiring> Store for Carrier<B> {}

impl<B: Wiring> Board for Carrier<B> {
    fn name(&self) -> &'static str {
        B::Part::NAME
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let core = self.0.part().core();
        vec![Target::new(B::Part::NAME, self.0.part_mut(), core)]
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![B::Part::NAME]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then(|| -> &mut dyn Mcu { self.0.part_mut() })
    }
}

/// A part with nothing around it: every pin open, every bus empty.
#[derive(Debug)]
pub struct Bare<P>(pub P);

impl<P: Part> Wiring for Bare<P> {
    type Part = P;

    fn part(&self) -> &P {
        &self.0
    }

    fn part_mut(&mut self) -> &mut P {
        &mut self.0
    }
}
