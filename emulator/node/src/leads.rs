//! A part on a board of its own with leads clipped to it: pins that are watched or driven, and a UART at each end.

use std::collections::BTreeMap;
use std::marker::PhantomData;

use emulator_part::{Pad, Part, Pin, UartFrame};

use super::{Board, Input};

/// A watched pin did something else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEdge {
    /// When, in virtual nanoseconds.
    pub at: u64,
    /// Which.
    pub pin: Pin,
    /// What the part does to it now.
    pub pad: Pad,
}

/// A level that is put on a pin from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drive {
    /// From when on, in virtual nanoseconds.
    pub at: u64,
    /// Which pin.
    pub pin: Pin,
    /// High or low.
    pub level: bool,
}

/// Bytes that are sent to a UART, one after the other, eight bits, no parity, one stop bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sending {
    /// When the first begins, in virtual nanoseconds.
    pub at: u64,
    /// The pin at which they arrive.
    pub pin: Pin,
    /// Bits a second.
    pub baud: u32,
    /// What is sent.
    pub bytes: Vec<u8>,
}

/// What is connected to a part that is otherwise alone.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Connected {
    /// Pins whose every change is told.
    pub watched: Vec<Pin>,
    /// Levels that are put on pins.
    pub driven: Vec<Drive>,
    /// Pins whose UART frames are collected.
    pub heard: Vec<Pin>,
    /// What is sent.
    pub sent: Vec<Sending>,
}

/// The board.
#[derive(Clone, Debug)]
pub struct Leads<P> {
    connected: Connected,
    /// What the part does to each watched pin.
    pads: BTreeMap<Pin, Pad>,
    edges: Vec<PinEdge>,
    heard: Vec<(Pin, u8)>,
    /// What is left to do from outside, the latest first: when, and what.
    plan: Vec<(u64, Input)>,
    part: PhantomData<P>,
}

impl<P> Leads<P> {
    /// With these leads.
    #[must_use]
    pub fn new(connected: Connected) -> Self {
        let mut plan: Vec<(u64, Input)> =
            connected.driven.iter().map(|drive| (drive.at, Input::Level(drive.pin, Some(drive.level)))).collect();
        for sending in &connected.sent {
            let mut at = sending.at;
            for &byte in &sending.bytes {
                let frame = UartFrame::eight_n_one(byte, sending.baud.max(1));
                // A frame is told at its end, and begins before it.
                plan.push((at + frame.ns(), Input::Frame(sending.pin, at, frame)));
                at += frame.ns();
            }
            // The line rests high.
            plan.push((0, Input::Level(sending.pin, Some(true))));
        }
        plan.sort_by_key(|&(at, _)| std::cmp::Reverse(at));
        Self { connected, pads: BTreeMap::new(), edges: vec![], heard: vec![], plan, part: PhantomData }
    }

    /// What watched pins did since the last call, in order.
    pub fn take_edges(&mut self) -> Vec<PinEdge> {
        std::mem::take(&mut self.edges)
    }

    /// The bytes that were heard since the last call, each with its pin.
    pub fn take_heard(&mut self) -> Vec<(Pin, u8)> {
        std::mem::take(&mut self.heard)
    }
}

impl<P: Part> Board for Leads<P> {
    type Part = P;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if self.connected.watched.contains(&pin) && self.pads.insert(pin, pad) != Some(pad) {
            self.edges.push(PinEdge { at, pin, pad });
        }
    }

    fn uart(&mut self, _: u64, pin: Pin, frame: &UartFrame) {
        if self.connected.heard.contains(&pin) {
            self.heard.push((pin, (frame.data & 0xFF) as u8));
        }
    }

    fn next_event(&self) -> u64 {
        self.plan.last().map_or(u64::MAX, |&(at, _)| at)
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        while let Some((_, input)) = self.plan.pop_if(|&mut (due, _)| due <= at) {
            inputs.push(input);
        }
    }
}
