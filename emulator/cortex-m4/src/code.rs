//! The cache of decoded instructions.
//!
//! | memory | what is decoded at a time, and when | what is dropped, and when |
//! |---|---|---|
//! | constant ([`Bus::is_constant`]) | a page, at its first execution | all pages, on [`crate::Signals::forget_code`] |
//! | watched ([`Bus::watch_code`]) | a page, at its first execution | a page, when a byte in it was written |
//! | other | each instruction, when it is first executed | an instruction, when memory holds other halfwords |
//!
//! A page has 1 KiB, and all of it must be memory of one kind. Clones of a core share decoded pages. A page that also
//! holds data may be written often, so a page that was decoded anew [`MOST_REWRITES`] times since the last reset is
//! no longer watched.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::op::{Do, Op};
use crate::{Bus, Fault, decode};

/// The number of address bits within a page.
pub(crate) const BITS: u32 = 10;
/// The number of halfwords of a page. Each has its own entry, because an instruction may begin at any halfword.
const SLOTS: usize = 1 << (BITS - 1);
/// The number of times that a whole page may be decoded anew because a byte in it was written.
const MOST_REWRITES: u32 = 64;
/// The number of entries in the index of pages, a power of two.
const INDEX: usize = 256;

/// The way in which the core makes sure that decoded instructions match memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Constant,
    Watched,
    Compared,
}

/// The decoded instructions of one page.
#[derive(Clone, Debug)]
pub(crate) struct Page {
    number: u32,
    kind: Kind,
    /// Whether the page's last instruction extends into the next page.
    straddles: bool,
    ops: [Op; SLOTS],
    /// For each halfword of the page, the encoding of the instruction that begins there, its first halfword in the low
    /// half. Empty unless the page is [`Kind::Compared`].
    halfwords: Vec<u32>,
}

impl Page {
    #[inline(always)]
    pub(crate) fn holds(&self, pc: u32) -> bool {
        pc >> BITS == self.number
    }

    /// The first address behind the page.
    #[inline(always)]
    pub(crate) fn end(&self) -> u32 {
        (self.number << BITS).wrapping_add(1 << BITS)
    }

    #[inline(always)]
    pub(crate) fn op(&self, pc: u32) -> &Op {
        &self.ops[(pc >> 1) as usize % SLOTS]
    }

    #[inline(always)]
    pub(crate) fn kind(&self) -> Kind {
        self.kind
    }

    /// Whether the memory of the page has not been written since the page was decoded.
    fn is_current<B: Bus>(&self, bus: &B) -> bool {
        self.kind != Kind::Watched
            || bus.is_watched(self.number << BITS) && (!self.straddles || bus.is_watched((self.number + 1) << BITS))
    }
}

/// The decoded pages of a core, and its breakpoints.
#[derive(Clone, Debug, Default)]
pub(crate) struct Code {
    pages: Vec<Arc<Page>>,
    /// For each hash of a page's number, the position in `pages` where that page may be.
    index: Vec<u16>,
    /// The caller's breakpoints, sorted.
    breakpoints: Vec<u32>,
    /// The addresses at which the FPB and the DWT have breakpoints, sorted.
    hardware: Vec<u32>,
    /// The number of times that each page was decoded anew because a byte in it was written.
    rewrites: BTreeMap<u32, u32>,
}

impl Code {
    /// Returns the position in `pages` of the page that has `pc`, and decodes the page if necessary.
    #[inline(always)]
    pub(crate) fn page<B: Bus>(&mut self, bus: &mut B, pc: u32) -> usize {
        let number = pc >> BITS;
        if let Some(&place) = self.index.get(hash(number))
            && let Some(page) = self.pages.get(usize::from(place))
            && page.number == number
        {
            return usize::from(place);
        }
        self.find(bus, number)
    }

    #[inline(always)]
    pub(crate) fn at(&self, place: usize) -> &Page {
        &self.pages[place]
    }

    /// Drops the pages in which a byte was written.
    #[cold]
    #[inline(never)]
    pub(crate) fn forget_rewritten<B: Bus>(&mut self, bus: &B) {
        let Self { pages, rewrites, .. } = self;
        pages.retain(|page| {
            let current = page.is_current(bus);
            if !current {
                *rewrites.entry(page.number).or_default() += 1;
            }
            current
        });
        self.index.clear();
    }

    /// Forgets how often each page was decoded anew, so that all pages are watched again. A firmware that copies its
    /// code into RAM writes each page at every start, however often it starts.
    pub(crate) fn forget_rewrites(&mut self) {
        self.rewrites.clear();
        self.pages.retain(|page| page.kind != Kind::Compared);
        self.index.clear();
    }

    #[cold]
    #[inline(never)]
    fn find<B: Bus>(&mut self, bus: &mut B, number: u32) -> usize {
        let place = self.pages.iter().position(|page| page.number == number).unwrap_or_else(|| {
            let page = self.decode_page(bus, number);
            self.pages.push(Arc::new(page));
            self.pages.len() - 1
        });
        self.index.resize(INDEX, 0);
        self.index[hash(number)] = u16::try_from(place).unwrap_or(u16::MAX);
        place
    }

    fn decode_page<B: Bus>(&self, bus: &mut B, number: u32) -> Page {
        let base = number << BITS;
        let kind = if bus.is_constant(base) {
            Kind::Constant
        } else if self.rewrites.get(&number).is_none_or(|&times| times < MOST_REWRITES) && bus.watch_code(base) {
            Kind::Watched
        } else {
            Kind::Compared
        };
        let ops = [decode::place(Do::Unknown); SLOTS];
        let mut page = Page { number, kind, straddles: false, ops, halfwords: Vec::new() };
        if kind == Kind::Compared {
            page.halfwords = vec![0; SLOTS];
            return page;
        }
        let mut next = bus.fetch(base);
        let mut address = base;
        for op in &mut page.ops {
            let here = next;
            next = bus.fetch(address.wrapping_add(2));
            *op = decode_at(address, here.ok(), next.ok());
            address = address.wrapping_add(2);
        }
        let last = bus.fetch(address.wrapping_sub(2)).is_ok_and(decode::is_wide);
        page.straddles = kind == Kind::Watched && last && bus.watch_code(address);
        let stops = self.breakpoints.iter().chain(&self.hardware);
        for &address in stops.filter(|&&address| address >> BITS == number) {
            page.ops[(address >> 1) as usize % SLOTS] = decode::place(Do::Breakpoint);
        }
        page
    }

    /// Decodes the instruction at `pc`, in memory whose changes are not watched. With `over`, a breakpoint at `pc` is
    /// ignored.
    #[inline(never)]
    pub(crate) fn changing<B: Bus>(&mut self, bus: &mut B, pc: u32, over: bool) -> Op {
        if over {
            let here = bus.fetch(pc).ok();
            return decode_at(pc, here, bus.fetch(pc.wrapping_add(2)).ok());
        }
        if self.breakpoints.binary_search(&pc).is_ok() || self.hardware.binary_search(&pc).is_ok() {
            return decode::place(Do::Breakpoint);
        }
        let place = self.page(bus, pc);
        let Ok(first) = bus.fetch(pc) else {
            return decode::fault(Fault::BusInstruction);
        };
        let second = if decode::is_wide(first) { bus.fetch(pc.wrapping_add(2)).ok() } else { Some(0) };
        let Some(second) = second else {
            return decode::fault(Fault::BusInstruction);
        };
        let halfwords = u32::from(first) | u32::from(second) << 16;
        let slot = (pc >> 1) as usize % SLOTS;
        let page = &self.pages[place];
        if page.halfwords.get(slot) == Some(&halfwords) && !matches!(page.ops[slot].what, Do::Unknown) {
            return page.ops[slot];
        }
        let op = decode_at(pc, Some(first), Some(second));
        let page = Arc::make_mut(&mut self.pages[place]);
        page.ops[slot] = op;
        if let Some(kept) = page.halfwords.get_mut(slot) {
            *kept = halfwords;
        }
        op
    }

    pub(crate) fn forget(&mut self) {
        self.pages.clear();
        self.index.clear();
    }

    pub(crate) fn set_breakpoint(&mut self, address: u32) {
        if let Err(place) = self.breakpoints.binary_search(&address) {
            self.breakpoints.insert(place, address);
            self.drop_page(address);
        }
    }

    pub(crate) fn clear_breakpoint(&mut self, address: u32) {
        if let Ok(place) = self.breakpoints.binary_search(&address) {
            self.breakpoints.remove(place);
            self.drop_page(address);
        }
    }

    pub(crate) fn is_callers(&self, address: u32) -> bool {
        self.breakpoints.binary_search(&address).is_ok()
    }

    pub(crate) fn set_hardware(&mut self, mut addresses: Vec<u32>) {
        addresses.sort_unstable();
        let before = std::mem::replace(&mut self.hardware, addresses.clone());
        for address in before.into_iter().chain(addresses) {
            self.drop_page(address);
        }
    }

    fn drop_page(&mut self, address: u32) {
        self.pages.retain(|page| page.number != address >> BITS);
        self.index.clear();
    }
}

/// Spreads page numbers over the index. Flash, RAM and their aliases begin at multiples of large powers of two, so the
/// low bits of a page's number alone would collide.
#[inline(always)]
const fn hash(number: u32) -> usize {
    (number ^ (number >> 12)) as usize % INDEX
}

fn decode_at(address: u32, first: Option<u16>, second: Option<u16>) -> Op {
    match (first, second) {
        (Some(first), _) if !decode::is_wide(first) => decode::narrow(address, first),
        (Some(first), Some(second)) => decode::wide(address, first, second),
        _ => decode::fault(Fault::BusInstruction),
    }
}
