//! A test bench for one peripheral alone: clocks, pads, and wires that record.

use std::collections::VecDeque;

use cortex_m4::Width;
use emulator_part::{Cycle, I2cAnswer, I2cEvent, Pin, SpiFrame, UartFrame};

use crate::cx::{Clocks, Cx, Effects, Pads, Peripheral, Signal, Wires};

#[derive(Clone, Debug, Default)]
pub(crate) struct Lines {
    pub(crate) spi: Vec<SpiFrame>,
    pub(crate) spi_answers: VecDeque<u32>,
    pub(crate) uart: Vec<(Cycle, UartFrame)>,
    pub(crate) i2c: Vec<(Cycle, I2cEvent)>,
    pub(crate) i2c_answers: VecDeque<I2cAnswer>,
    pub(crate) microvolts: i32,
}

impl Wires for Lines {
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32> {
        self.spi.push(*frame);
        self.spi_answers.pop_front()
    }

    fn uart(&mut self, at: Cycle, _: Pin, frame: &UartFrame) {
        self.uart.push((at, *frame));
    }

    fn i2c(&mut self, at: Cycle, _: Pin, _: Pin, event: I2cEvent) -> I2cAnswer {
        self.i2c.push((at, event));
        self.i2c_answers.pop_front().unwrap_or(I2cAnswer::NOBODY)
    }

    fn microvolts(&self, _: Cycle, _: Pin) -> i32 {
        self.microvolts
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Rig<P> {
    pub(crate) instance: P,
    pub(crate) now: Cycle,
    pub(crate) clocks: Clocks,
    pub(crate) pads: Pads,
    pub(crate) out: Effects,
    pub(crate) lines: Lines,
}

impl<P: Peripheral> Rig<P> {
    pub(crate) fn new(instance: P) -> Self {
        let mut rig = Self {
            instance,
            now: 0,
            clocks: Clocks::AFTER_RESET,
            pads: Pads::OPEN,
            out: Effects::default(),
            lines: Lines::default(),
        };
        rig.change_clocks(|_| {});
        rig
    }

    pub(crate) fn connect(&mut self, signal: Signal, port: u8, number: u8) {
        self.pads.routes[signal.index()][0] = Some(Pin::new(port, number));
    }

    pub(crate) fn change_clocks(&mut self, change: impl FnOnce(&mut Clocks)) {
        let old = self.clocks;
        change(&mut self.clocks);
        self.call(|instance, cx| instance.clocks_changed(&old, cx));
    }

    pub(crate) fn call<R>(&mut self, call: impl FnOnce(&mut P, &mut Cx) -> R) -> R {
        let mut cx = Cx {
            now: self.now,
            clocks: &self.clocks,
            pads: &self.pads,
            out: &mut self.out,
            pc: None,
            name: "UNDER TEST",
        };
        call(&mut self.instance, &mut cx)
    }

    pub(crate) fn run(&mut self, to: Cycle) {
        while self.instance.due() <= to {
            self.now = self.instance.due().max(self.now);
            let mut cx = Cx {
                now: self.now,
                clocks: &self.clocks,
                pads: &self.pads,
                out: &mut self.out,
                pc: None,
                name: "UNDER TEST",
            };
            self.instance.advance(&mut cx, &mut self.lines);
            assert!(self.instance.due() > self.now, "what was due is done");
        }
        self.now = self.now.max(to);
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32) {
        self.run(self.now);
        self.call(|instance, cx| instance.write(offset, Width::Word, value, cx));
    }

    pub(crate) fn read(&mut self, offset: u32) -> u32 {
        self.run(self.now);
        self.call(|instance, cx| instance.read(offset, Width::Word, cx))
    }

    pub(crate) fn input(&mut self, signal: Signal, level: bool) {
        self.run(self.now);
        self.call(|instance, cx| instance.input(signal, level, cx));
    }

    pub(crate) fn found(&self, words: &str) -> bool {
        self.out.notes.iter().any(|note| note.text.contains(words))
    }
}
