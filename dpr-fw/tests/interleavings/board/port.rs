//! The SSI in the model, with the register accesses of `hw/ssi.rs` in their order.

use std::{borrow::Borrow, ops::Range};

use dpr_fw::{
    port::areas::HandedOver,
    publish::{Doorbell, Events, Ssi},
    ssi::Asked,
    triple::Received,
    ImageMemory,
};

use super::{At, Board, Buffer};
use crate::{
    explorer::{broken, holds},
    hardware::{Hardware, Semaphore, Window},
    Mutation, HALF_BYTES, LEN,
};

impl At {
    fn announce_generation(&self, generation: u8) {
        let Board { hw, bounds, .. } = &*self.0;
        self.point("FRESH rises");
        hw.borrow_mut().announced = generation;
        if bounds.mutation == Mutation::EventClearedBeforeTimer {
            self.point("clears the event of the first compare");
            hw.borrow_mut().compare = false;
        }
        self.point("clears and starts the expiry timer");
        hw.borrow_mut().clear_timer();
        if bounds.mutation != Mutation::EventClearedBeforeTimer {
            self.point("clears the event of the first compare");
            hw.borrow_mut().compare = false;
        }
        hw.borrow_mut().just_cleared = false;
    }
}

impl Doorbell for At {
    fn request(&mut self) -> bool {
        let Board { hw, bounds, .. } = &*self.0;
        // The image was put into the mailbox before this request, so it counts as published.
        let generation = self.0.generation.get();
        hw.borrow_mut().published = generation;
        if bounds.mutation == Mutation::FreshBeforeTaken {
            self.announce_generation(generation);
        }
        self.point("ACQUIRE");
        hw.borrow_mut().acquire();
        self.point("reads SEMSTAT");
        let semaphore = hw.borrow().semaphore;
        self.see(semaphore);
        let is_under_way = matches!(semaphore, Semaphore::Spis | Semaphore::CpuPending);
        if !is_under_way {
            self.call(|called| called.ssi = true);
        }
        is_under_way
    }

    fn announce(&mut self) {
        let generation = self.0.hw.borrow().published;
        self.announce_generation(generation);
    }
}

#[derive(Debug)]
pub(crate) struct SsiModel {
    at: At,
    image: Option<Received<Buffer, ()>>,
    received: [u8; 8],
    /// Whether FRESH is to rise after the release. Correct code never does this ([`Mutation::FreshAfterRelease`]).
    fresh: bool,
    newer: bool,
}

impl SsiModel {
    pub(super) fn new(at: At) -> Self {
        Self { at, image: None, received: [0; 8], fresh: false, newer: false }
    }

    pub(super) fn image(&self) -> &impl std::fmt::Debug {
        &self.image
    }

    fn generation(&self) -> u8 {
        let words: &ImageMemory = self.image.as_ref().expect("an image was loaded").memory().borrow();
        u8::try_from(words[0]).expect("a generation")
    }
}

impl Ssi for SsiModel {
    type Buffer = Buffer;

    fn take_events(&mut self) -> Events<'_> {
        let at = self.at.clone();
        let Board { hw, bounds, .. } = &*at.0;
        let early = bounds.mutation == Mutation::NoFenceAfterEnd;
        if early {
            self.received = hw.borrow().rxd;
        }
        let mut ended = false;
        let mut take_end = || {
            at.point("reads and clears END");
            ended = std::mem::take(&mut hw.borrow_mut().end);
            at.see(ended);
        };
        if bounds.mutation == Mutation::EndBeforeSemaphore {
            take_end();
        }
        at.point("clears ACQUIRED");
        hw.borrow_mut().acquired = false;
        at.point("reads SEMSTAT");
        let ours = hw.borrow().semaphore == Semaphore::Cpu;
        at.see(ours);
        if bounds.mutation != Mutation::EndBeforeSemaphore {
            take_end();
        }
        if !ended {
            return Events { ours, received: None, over_read: false, overflow: false };
        }
        if bounds.mutation != Mutation::NoPause {
            at.point("masks END and ACQUIRED");
            hw.borrow_mut().masked = true;
        }
        at.point("reads AMOUNT and the first half of what came in");
        let amount = hw.borrow().amount;
        if !early {
            self.received[..4].copy_from_slice(&hw.borrow().rxd[..4]);
            at.point("reads the second half of what came in");
            self.received[4..].copy_from_slice(&hw.borrow().rxd[4..]);
        }
        at.see((amount, self.received));
        if bounds.mutation == Mutation::None {
            // RXD and AMOUNT are cleared, since both are written before they are read again. So the search has fewer
            // different states.
            hw.borrow_mut().rxd = [0; 8];
            hw.borrow_mut().amount = 0;
        }
        Events { ours, received: Some(&self.received[..amount]), over_read: false, overflow: false }
    }

    /// The model has a single receive area. Another test covers the way of an area to the port task.
    fn hand_over(&mut self, _: Asked) -> HandedOver {
        HandedOver::Empty
    }

    fn pass_on(&mut self) {
        let Board { hw, bounds, .. } = &*self.at.0;
        if bounds.mutation == Mutation::PauseWithoutEnd {
            return;
        }
        hw.borrow_mut().pause_begins = true;
        self.at.point("sets the compare that ends the pause, and clears its event");
        let mut hw = hw.borrow_mut();
        (hw.pause_begins, hw.pause_runs) = (false, true);
        hw.pause_over &= bounds.mutation == Mutation::OldPauseEndKept;
    }

    fn is_expired(&mut self) -> bool {
        let Board { hw, bounds, .. } = &*self.at.0;
        self.at.point("reads the event of the first compare");
        let expired = hw.borrow().compare;
        self.at.see(expired);
        match bounds.mutation {
            Mutation::ReleasedAfterExpiry => false,
            Mutation::ExpiryNotAskedAgain => expired && !self.newer,
            _ => expired,
        }
    }

    fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<Buffer, ()>>) -> (Option<Received<Buffer, ()>>, R),
    ) -> R {
        holds(self.at.0.hw.borrow().semaphore == Semaphore::Cpu, "an image is exchanged while the SPIS has it");
        let before = self.image.as_ref().map(|image| image.memory().place());
        let (image, result) = with(self.image.take());
        self.newer = image.as_ref().map(|image| image.memory().place()) != before;
        self.image = image;
        result
    }

    fn load(&mut self, window: Range<usize>) -> bool {
        let Some(image) = &self.image else { return false };
        let Board { hw, .. } = &*self.at.0;
        self.at.point("sets the pointers");
        holds(hw.borrow().semaphore == Semaphore::Cpu, "the pointers are set while the SPIS has the buffers");
        let window = match window {
            whole if whole == (0..LEN) => Window::Whole,
            upper if upper == (HALF_BYTES..LEN) => Window::UpperHalf,
            other => broken(format!("a window that nobody asked for: {other:?}")),
        };
        hw.borrow_mut().txd = Some((image.memory().place(), window));
        true
    }

    fn announce(&mut self) {
        if self.at.0.bounds.mutation == Mutation::FreshAfterRelease {
            self.fresh = true;
        } else {
            self.at.announce_generation(self.generation());
        }
    }

    fn release(&mut self) {
        let Board { hw, bounds, .. } = &*self.at.0;
        if bounds.mutation != Mutation::NoFenceBeforeRelease {
            let mut hw = hw.borrow_mut();
            let Hardware { ram, held_back, .. } = &mut *hw;
            for (half, held_back) in ram.iter_mut().zip(held_back) {
                half[1] = held_back.take().unwrap_or(half[1]);
            }
        }
        self.at.point("RELEASE");
        hw.borrow_mut().release();
        if std::mem::take(&mut self.fresh) {
            self.at.announce_generation(self.generation());
        }
    }
}
