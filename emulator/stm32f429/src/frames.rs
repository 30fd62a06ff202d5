//! Exchanges SPI frames with memory by two DMA streams, byte by byte. This is the most frequent event of a part that
//! talks to its chips. The effects of such a byte are known beforehand, so they are carried out at once.
//! [`Stm32f429::settle`] would have the same result in several rounds. That function handles what this module leaves
//! out: every other width and mode, and the items at which a stream reports something or ends.

use super::*;

/// The two DMA streams that serve one SPI: the controller, and the numbers of the streams that receive and send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pair {
    controller: u8,
    receives: u8,
    sends: u8,
}

impl Stm32f429 {
    /// Finds the two streams that serve each SPI. It is called when a stream was switched on or off.
    pub(crate) fn pair_streams(&mut self) {
        self.pairs = [None; 6];
        for (controller, dma) in self.dma.iter().enumerate() {
            let mut found = [[0_u8; 2]; 6];
            for (nth, stream) in dma.streams.iter().enumerate() {
                let (instance, mask) = stream.source;
                if mask != 0 && instance < id::USART {
                    let simple = stream.moves_bytes(mask == 1) && id::at(stream.register()) == (instance, spi::DATA);
                    let found = &mut found[usize::from(instance)][usize::from(mask - 1)];
                    // An SPI has no pair if a second stream serves the same request, or if the stream does not move
                    // single bytes to or from the SPI's data register.
                    *found |= if *found == 0 && simple { 1 << nth } else { 0xFF };
                }
            }
            for (pair, [receives, sends]) in self.pairs.iter_mut().zip(found) {
                if receives.count_ones() == 1 && sends.count_ones() == 1 {
                    let (receives, sends) = (receives.trailing_zeros() as u8, sends.trailing_zeros() as u8);
                    *pair = Some(Pair { controller: controller as u8, receives, sends });
                }
            }
        }
    }

    /// Moves the byte of the frame that an SPI has just ended to memory, and the next byte from memory to the SPI.
    /// Returns `false`, with nothing done, if the byte may have any other effect.
    #[inline]
    pub(crate) fn exchange(&mut self, number: u8, now: Cycle) -> bool {
        let Some(Pair { controller, receives, sends }) = self.pairs[usize::from(number)] else { return false };
        let (nth, receives, sends) = (usize::from(controller & 1), usize::from(receives & 7), usize::from(sends & 7));
        let streams = &mut self.dma[nth].streams;
        let [to, from] = [receives, sends].map(|stream| streams[stream].memory.wrapping_sub(SRAM_BASE));
        if (self.dirty, self.hungry) != (0, 0)
            || now < self.dma_pauses_until[nth]
            || !self.spi[usize::from(number)].awaits_dma()
            || !streams[receives].is_amid()
            || !streams[sends].is_amid()
            || to >= SRAM_SIZE
            || from >= SRAM_SIZE
            || !self.is_open(number)
        {
            return false;
        }
        let streams = &mut self.dma[nth].streams;
        let (first, second) = (streams[receives].priority(), streams[sends].priority());
        let receives_first = first > second || first == second && receives < sends;
        // The order of the streams matters if both use the same buffer.
        for receive in [receives_first, !receives_first] {
            if receive {
                let value = self.spi[usize::from(number)].take_byte();
                streams[receives].pass_byte();
                let _ = self.sram.write(to, Width::Byte, value);
            } else {
                let read = || self.sram.read(from, Width::Byte).unwrap_or(0);
                let value = streams[sends].next_byte(read);
                self.spi[usize::from(number)].put_byte(value);
            }
        }
        self.requests[usize::from(number)] = 0;
        self.set_due(number, self.spi[usize::from(number)].due().max(self.now));
        true
    }
}

#[cfg(test)]
mod tests {
    use emulator_part::{I2cAnswer, I2cEvent, Pad, UartFrame};

    use super::*;

    const SPI1: u32 = 0x4001_3000;
    const DMA2: u32 = 0x4002_6400;

    /// The outside of the part. It answers each frame with the next number.
    #[derive(Clone, Default)]
    struct Counting(u32);

    impl Outside for Counting {
        fn pin(&mut self, _: Cycle, _: Pin, _: Pad) {}
        fn spi(&mut self, frame: &emulator_part::SpiFrame) -> Option<u32> {
            self.0 += 1;
            Some((frame.data ^ (37 * self.0)) & 0xFF)
        }
        fn uart(&mut self, _: Cycle, _: Pin, _: &UartFrame) {}
        fn i2c(&mut self, _: Cycle, _: Pin, _: Pin, _: I2cEvent) -> I2cAnswer {
            I2cAnswer::NOBODY
        }
        fn microvolts(&self, _: Cycle, _: Pin) -> i32 {
            0
        }
    }

    fn next(state: &mut u64) -> u32 {
        *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let word = (*state ^ *state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (word ^ word >> 27).wrapping_mul(0x94D0_49BB_1331_11EB) as u32 >> 4
    }

    /// The test draws settings of SPI1 and of its two streams: priorities, widths, circular mode, lengths, and buffers
    /// that overlap. It also draws whether [`Stm32f429::exchange`] can handle the setting.
    #[test]
    fn a_byte_exchanged_at_once_leaves_what_settling_leaves() {
        let (mut state, mut handled) = (1, 0);
        for case in 0..400 {
            let mut part = Stm32f429::new(Oscillators::default());
            let mut now = 0;
            let mut write = |part: &mut Stm32f429, address, value| {
                now += 2;
                part.now = now;
                part.bus_write(address, Width::Word, value, now, None, None::<&mut Counting>).unwrap();
                part.settle(now, &mut Counting::default());
            };
            write(&mut part, 0x4002_3830, 1 << 22 | 1);
            write(&mut part, 0x4002_3844, 1 << 12);
            // PA5, PA6 and PA7 are SCK, MISO and MOSI.
            write(&mut part, 0x4002_0020, 0x5550_0000);
            write(&mut part, 0x4002_0000, 0xA800_A800);
            for at in (0..64).step_by(4) {
                assert!(part.sram.write(at, Width::Word, next(&mut state) << 4));
            }
            let rare = |state: &mut u64, bit: u32| if next(state).is_multiple_of(8) { bit } else { 0 };
            for (stream, channel_and_direction) in [(0x10, 3 << 25), (0x58, 3 << 25 | 1 << 6)] {
                write(&mut part, DMA2 + stream + 4, 1 + next(&mut state) % 9);
                write(&mut part, DMA2 + stream + 8, SPI1 + spi::DATA);
                write(&mut part, DMA2 + stream + 12, SRAM_BASE + next(&mut state) % 8);
                let drawn = next(&mut state) & (3 << 16 | 1 << 10 | 1 << 8 | 0x18);
                let width = rare(&mut state, 1 << 11) | rare(&mut state, 1 << 9);
                write(&mut part, DMA2 + stream, channel_and_direction | drawn | width | 1);
            }
            write(&mut part, SPI1 + 4, 3 | rare(&mut state, 1 << 6) | rare(&mut state, 1 << 5));
            let lsb_first = next(&mut state) & 1 << 7;
            write(&mut part, SPI1, 0x344 | lsb_first | rare(&mut state, 1 << 13) | rare(&mut state, 1 << 11));
            let mut slow = part.clone();
            let (mut outside, mut slow_outside) = (Counting::default(), Counting::default());
            for byte in 0..24 {
                let at = part.next;
                if at == NEVER {
                    break;
                }
                handled += u32::from(part.pairs[0].is_some());
                part.advance(at, &mut outside);
                slow.pairs = [None; 6];
                slow.advance(at, &mut slow_outside);
                let of = |part: &Stm32f429| {
                    let Stm32f429 { spi, dma, requests, hungry, due, next, dirty, signals, .. } = part;
                    format!("{:?} {dma:?} {requests:?} {hungry} {due:?} {next} {dirty} {signals:?}", spi[0])
                };
                assert_eq!(of(&part), of(&slow), "case {case}, byte {byte}");
                assert_eq!(part.sram.bytes()[..64], slow.sram.bytes()[..64], "case {case}, byte {byte}");
            }
            assert_eq!(part.findings.len(), slow.findings.len());
        }
        assert!(handled > 1000, "{handled}");
    }
}
