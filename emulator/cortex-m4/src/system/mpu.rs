//! The memory protection unit, ARM ARM B3.5, and the default memory map's execute-never regions, B3.1.
//!
//! | Covered | ARM ARM |
//! |---|---|
//! | TYPE, CTRL, RNR, RBAR, RASR and their three aliases | B3.5.5 to B3.5.10 |
//! | sizes, subregions, overlap, AP, XN, the background map | B3.5.1 to B3.5.3 |
//!
//! Left out: the memory attributes (TEX, S, C, B) read back without effect.

const ENABLE: u32 = 1;
const HFNMIENA: u32 = 1 << 1;
const PRIVDEFENA: u32 = 1 << 2;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Region {
    /// Bits 31:5 of RBAR.
    base: u32,
    attributes: u32,
}

impl Region {
    /// The binary logarithm of the region's size in bytes (ARM ARM B3.5.9), `None` if the region is off.
    fn size(self) -> Option<u32> {
        let size = (self.attributes >> 1 & 0x1F) + 1;
        (self.attributes & 1 != 0 && size >= 5).then_some(size)
    }

    /// Whether the region is on and contains `address`, ARM ARM B3.5.3.
    fn has(self, address: u32) -> bool {
        let Some(size) = self.size() else { return false };
        if u64::from(address ^ self.base) >> size != 0 {
            return false;
        }
        // Each eighth of a region of 256 bytes or more can be disabled.
        size < 8 || self.attributes >> (8 + ((address >> (size - 3)) & 7)) & 1 == 0
    }

    /// Whether RASR.AP allows an access, ARM ARM table B3-15.
    fn allows(self, write: bool, privileged: bool) -> bool {
        match self.attributes >> 24 & 7 {
            1 => privileged,
            2 => privileged || !write,
            3 => true,
            5 => privileged && !write,
            6 | 7 => !write,
            _ => false,
        }
    }
}

/// A range of addresses that all have the same rights while the MPU applies. The struct has sixteen bytes, so that a
/// shift finds an entry in a list of spans.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
struct Span {
    first: u32,
    /// The difference between the last address and the first.
    extent: u32,
    /// The rights of privileged code. Those of unprivileged code are [`UNPRIVILEGED`] bits higher.
    rights: u32,
}

impl Span {
    /// Makes a span that contains no address whose highest four bits are `place`.
    const fn elsewhere(place: u32) -> Self {
        Self { first: (place ^ 8) << 28, extent: 0, rights: 0 }
    }

    #[inline(always)]
    const fn has(&self, address: u32, bytes: u32) -> bool {
        let offset = address.wrapping_sub(self.first);
        offset <= self.extent && self.extent - offset >= bytes - 1
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Mpu {
    control: u32,
    number: u32,
    count: u32,
    regions: [Region; 8],
    /// The spans of all addresses, in rising order. The list is empty if it must be computed again.
    spans: Vec<Span>,
    /// The span that was last looked up, for each value of the address's highest four bits.
    near: [Span; 16],
}

const READ: u32 = 1;
const WRITE: u32 = 2;
const EXECUTE: u32 = 4;
const UNPRIVILEGED: u32 = 3;

#[inline(always)]
pub(crate) const fn data_right(write: bool, privileged: bool) -> u32 {
    (if write { WRITE } else { READ }) << if privileged { 0 } else { UNPRIVILEGED }
}

#[inline(always)]
const fn fetch_right(privileged: bool) -> u32 {
    EXECUTE << if privileged { 0 } else { UNPRIVILEGED }
}

/// Whether the default memory map lets code execute at `address`, ARM ARM table B3-1: in code, SRAM and external RAM.
fn default_executable(address: u32) -> bool {
    matches!(address >> 29, 0 | 1 | 3 | 4)
}

impl Mpu {
    pub(crate) fn new(regions: u8) -> Self {
        Self {
            control: 0,
            number: 0,
            count: u32::from(regions.min(8)),
            regions: [Region::default(); 8],
            spans: Vec::new(),
            near: std::array::from_fn(|place| Span::elsewhere(place as u32)),
        }
    }

    fn forget(&mut self) {
        self.spans.clear();
        self.near = std::array::from_fn(|place| Span::elsewhere(place as u32));
    }

    /// Computes the spans. Rights change only where a region, an eighth of a region or an area of the default map
    /// begins or ends.
    fn work_out(&mut self) {
        // Rights change at 8 + 8 · 9 addresses at most: the default map has eight areas, and each of eight regions has
        // two ends and seven addresses between its eighths.
        let mut edges = [0_u32; 8 + 8 * 9];
        let mut count = 0;
        let mut add = |edge: u32| {
            edges[count] = edge;
            count += 1;
        };
        (0..8).for_each(|area| add(area << 29));
        for region in self.regions {
            let Some(size) = region.size() else { continue };
            let parts = if size > 7 && region.attributes >> 8 & 0xFF != 0 { 8_u64 } else { 1 };
            let first = region.base & !(((1_u64 << size) - 1) as u32);
            (0..=parts).for_each(|part| add(first.wrapping_add(((part << size) / parts) as u32)));
        }
        let edges = &mut edges[..count];
        edges.sort_unstable();
        for index in 0..edges.len() {
            let (first, last) = (edges[index], edges.get(index + 1).map_or(u32::MAX, |next| next.wrapping_sub(1)));
            if last.wrapping_add(1) == first {
                continue;
            }
            let rights = self.decide(first);
            match self.spans.last_mut() {
                Some(before) if before.rights == rights => before.extent = last - before.first,
                _ => self.spans.push(Span { first, extent: last - first, rights }),
            }
        }
    }

    /// The rights at `address` while the MPU applies, or by the default map while the MPU is off.
    fn decide(&self, address: u32) -> u32 {
        let region = self.region(address);
        let mut rights = 0;
        for privileged in [true, false] {
            for write in [false, true] {
                if !self.enabled() || self.decide_data(region, write, privileged) {
                    rights |= data_right(write, privileged);
                }
            }
            let executes = if self.enabled() {
                self.decide_fetch(region, address, privileged)
            } else {
                default_executable(address)
            };
            rights |= if executes { fetch_right(privileged) } else { 0 };
        }
        rights
    }

    /// Looks up the span of `address`, and keeps the span in `near`.
    #[cold]
    #[inline(never)]
    fn approach(&mut self, address: u32) -> Span {
        if self.spans.is_empty() {
            self.work_out();
        }
        let behind = self.spans.partition_point(|span| span.first <= address);
        let span = self.spans[behind - 1];
        self.near[(address >> 28) as usize] = span;
        span
    }

    #[inline(always)]
    fn span(&mut self, address: u32) -> Span {
        let near = self.near[(address >> 28) as usize];
        if near.has(address, 1) { near } else { self.approach(address) }
    }

    /// Whether `right` (of [`data_right`]) is given at `address`, whatever the priority is. Spans begin and end at
    /// multiples of 32, so an aligned access is always within one span.
    #[inline(always)]
    pub(crate) fn gives(&mut self, address: u32, right: u32) -> bool {
        let near = &self.near[(address >> 28) as usize];
        let rights = if near.has(address, 1) { near.rights } else { self.approach(address).rights };
        rights & right != 0
    }

    /// Whether code may access all of `bytes` from `address` on, whatever the priority is. Returns false if the bytes
    /// lie in more than one span, even if each of them may be accessed.
    #[inline(always)]
    pub(crate) fn opens(&mut self, address: u32, bytes: u32, write: bool, privileged: bool) -> bool {
        let span = self.span(address);
        span.rights & data_right(write, privileged) != 0 && span.has(address, bytes)
    }

    /// Whether code may execute all of the page of `1 << bits` bytes that has `address`, whatever the priority is. An
    /// instruction that extends beyond the page's end is included.
    #[inline(always)]
    pub(crate) fn opens_page(&mut self, address: u32, bits: u32, privileged: bool) -> bool {
        let span = self.span(address);
        span.rights & fetch_right(privileged) != 0 && span.has(address >> bits << bits, (1 << bits) + 2)
    }

    pub(crate) fn enabled(&self) -> bool {
        self.control & ENABLE != 0
    }

    /// Whether the MPU is on at this execution priority. It is off in NMI and HardFault unless HFNMIENA is set.
    fn applies(&self, priority: i32) -> bool {
        self.enabled() && (priority >= 0 || self.control & HFNMIENA != 0)
    }

    fn region(&self, address: u32) -> Option<Region> {
        self.regions.iter().rev().copied().find(|region| region.has(address))
    }

    pub(crate) fn data(&mut self, address: u32, write: bool, privileged: bool, priority: i32) -> bool {
        // The default memory map always governs the private peripheral bus (ARM ARM B3.5.1).
        !self.applies(priority)
            || address >> 20 == 0xE00
            || self.span(address).rights & data_right(write, privileged) != 0
    }

    fn decide_data(&self, region: Option<Region>, write: bool, privileged: bool) -> bool {
        match region {
            Some(region) => region.allows(write, privileged),
            None => privileged && self.control & PRIVDEFENA != 0,
        }
    }

    pub(crate) fn fetch(&mut self, address: u32, privileged: bool, priority: i32) -> bool {
        if !self.applies(priority) {
            return default_executable(address);
        }
        self.span(address).rights & fetch_right(privileged) != 0
    }

    fn decide_fetch(&self, region: Option<Region>, address: u32, privileged: bool) -> bool {
        match region {
            // System space is execute-never, whatever a region says (ARM ARM B3.1).
            Some(region) => {
                region.allows(false, privileged) && region.attributes >> 28 & 1 == 0 && address < 0xE000_0000
            }
            None => privileged && self.control & PRIVDEFENA != 0 && default_executable(address),
        }
    }

    pub(crate) fn read(&self, offset: u32) -> u32 {
        let region = self.regions[(self.number & 7) as usize];
        match offset {
            _ if self.count == 0 => 0,
            0x00 => self.count << 8,
            0x04 => self.control,
            0x08 => self.number,
            0x0C | 0x14 | 0x1C | 0x24 => region.base | self.number,
            _ => region.attributes,
        }
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32) {
        if self.count == 0 {
            return;
        }
        let before = (self.control, self.regions);
        match offset {
            0x00 => {}
            0x04 => self.control = value & (ENABLE | HFNMIENA | PRIVDEFENA),
            0x08 => self.number = (value & 0xFF) % self.count,
            0x0C | 0x14 | 0x1C | 0x24 => {
                // With VALID, the write selects the region that it names, and RNR becomes its number.
                if value & 1 << 4 != 0 {
                    self.number = (value & 0xF) % self.count;
                }
                self.regions[(self.number & 7) as usize].base = value & !0x1F;
            }
            _ => self.regions[(self.number & 7) as usize].attributes = value & 0x173F_FF3F,
        }
        if before != (self.control, self.regions) {
            self.forget();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn next(state: &mut u64) -> u32 {
        *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let word = (*state ^ *state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (word ^ word >> 27).wrapping_mul(0x94D0_49BB_1331_11EB) as u32
    }

    /// The regions have random sizes and subregions, and are close to each other so that they overlap.
    #[test]
    fn the_spans_say_of_every_address_what_the_regions_say() {
        let mut state = 1;
        for _ in 0..2000 {
            let mut mpu = Mpu::new(8);
            for number in 0..8 {
                mpu.write(0x08, number);
                let draw = next(&mut state);
                let size = if draw & 7 == 0 { 31 } else { 4 + draw % 20 };
                mpu.write(0x0C, 0x2000_0000 + (next(&mut state) & 0x000F_FFE0));
                let disabled = if draw & 8 == 0 { 0 } else { next(&mut state) & 0xFF00 };
                mpu.write(0x10, (next(&mut state) & 0x1700_0000) | disabled | size << 1 | u32::from(draw & 0x30 != 0));
            }
            mpu.write(0x04, next(&mut state) & 7);
            mpu.span(0);
            let ends = mpu.spans.iter().flat_map(|span| [span.first, span.first + span.extent]).collect::<Vec<_>>();
            let (first, last) = (ends.first().copied(), ends.last().copied());
            assert_eq!((first, last), (Some(0), Some(u32::MAX)));
            let drawn = (0..100).map(|_| 0x2000_0000 | next(&mut state) & 0x001F_FFFF);
            for address in ends.iter().copied().chain(drawn).chain((0..16).map(|place| place << 28)) {
                assert_eq!(mpu.span(address).rights, mpu.decide(address), "{address:#x}");
            }
            for pair in ends[1..ends.len() - 1].chunks(2) {
                assert_eq!(pair[0].wrapping_add(1), pair[1], "no address is left out");
                // This access crosses the end of a span, so `opens` must return false.
                assert!(!mpu.opens(pair[0], 2, false, true) && !mpu.opens(pair[0], 2, true, false));
            }
        }
    }
}
