//! The tasks of `main.rs` in the model. Plain code stands in for the driver of the front end and for the acceptance.

use dpr_fw::{
    commit::Images,
    publish::{Doorbell, Mailbox, Outbox},
    triple::{scrub_waiting, Received, Rotated},
    IMAGE_WORDS,
};
use rtic_core::Mutex;

use super::{At, Buffer, RotationOf, FILLING, RECEIVING, SSI};
use crate::{explorer::holds, Mutation};

impl At {
    pub(super) fn ssi_end(&self) {
        self.0.hw.borrow_mut().expired_in_task = false;
        self.see(self.0.digests.get()[SSI]);
        let (mut server, mut port) = self.0.ssi.borrow_mut().take().expect("it does not interrupt itself");
        server.serve(&mut port, self.clone(), &self.0.telemetry);
        self.redigest(SSI, &(&server, port.image()));
        *self.0.ssi.borrow_mut() = Some((server, port));
        self.0.hw.borrow_mut().expired_in_task = false;
    }

    /// Runs the RFID tasks at the end of a frame ([`dpr_fw::rf::Reception::serve`]), which is whole or lost.
    pub(super) fn receive(&self, whole: bool) {
        self.see((whole, self.0.digests.get()[RECEIVING]));
        let filled = self.0.receiving.borrow_mut().take().expect("the port has one");
        let frame = self.0.hw.borrow().frame;
        let next = RotationOf(self.clone()).lock(|rotation| {
            if whole {
                let (next, rotated) = rotation.rotate(filled, frame);
                if rotated == Rotated::Handed {
                    self.0.handed.borrow_mut().push(frame);
                }
                next
            } else {
                rotation.replace(filled).0
            }
        });
        {
            let mut hw = self.0.hw.borrow_mut();
            hw.receiving = next.peek().place();
            hw.arrived = 0;
            hw.frame += 1;
        }
        self.redigest(RECEIVING, &next);
        *self.0.receiving.borrow_mut() = Some(next);
        self.call(|called| called.commit = true);
    }

    /// Runs `commit` and `deadline` ([`dpr_fw::intake`]): an image for each frame that waits, or one without objects.
    pub(super) fn commit(&self) {
        self.see(self.0.digests.get()[FILLING]);
        let mut filling = self.0.filling.borrow_mut().take();
        let mut outbox = Outbox {
            mailbox: self.clone(),
            filling: &mut filling,
            doorbell: self.clone(),
            port: &dpr_fw::hold::Area::EMPTY,
            telemetry: &self.0.telemetry,
        };
        let mut frames = 0;
        while let Some(received) = self.next_frame() {
            frames += 1;
            let (frame, place) = (*received.about(), received.memory().place());
            self.forget_all_but(("reading", frames, frame, place, self.0.digests.get()[FILLING]));
            let next = self.0.handed.borrow().first().copied();
            holds(next == Some(frame), "frames are not read once each, in their order");
            self.0.handed.borrow_mut().remove(0);
            for half in 0..2 {
                self.point("reads half of the frame");
                let read = self.0.hw.borrow().ram[place][half];
                holds(read == u32::from(frame), "what is read is not the frame that was handed on");
            }
            self.publish(&mut outbox, Some(place));
            RotationOf(self.clone()).lock(|rotation| rotation.done(received));
            self.forget_all_but(("read", frames > 0));
        }
        if frames == 0 {
            self.publish(&mut outbox, None);
        }
        if self.0.bounds.publishes {
            outbox.prepare();
        }
        self.redigest(FILLING, &filling);
        *self.0.filling.borrow_mut() = filling;
        self.call(|called| called.scrub = true);
    }

    fn next_frame(&self) -> Option<Received<Buffer, u8>> {
        let put_by = self.0.put_by.borrow_mut().take();
        put_by.or_else(|| {
            RotationOf(self.clone()).lock(|rotation| {
                let oldest = rotation.read();
                if self.0.bounds.mutation == Mutation::RotationOrder {
                    if let Some(newer) = rotation.read() {
                        *self.0.put_by.borrow_mut() = oldest;
                        return Some(newer);
                    }
                }
                oldest
            })
        })
    }

    fn publish<M: Mutex<T = Mailbox<Buffer>>, D: Doorbell>(
        &self,
        outbox: &mut Outbox<'_, M, Buffer, D>,
        received: Option<usize>,
    ) {
        if !self.0.bounds.publishes {
            return;
        }
        let generation = self.0.generation.get() + 1;
        holds(outbox.filling() == &[0; IMAGE_WORDS], "an image is filled over old data");
        let place = outbox.filling.as_mut().expect("just taken").memory().place();
        self.forget_all_but(("filling", place, received));
        {
            let hw = self.0.hw.borrow();
            holds(hw.ram[place] == [0; 2] && hw.held_back[place].is_none(), "an image is filled over old data");
            holds(hw.found != Some(place), "an image is filled that is out of use");
        }
        outbox.filling().fill(u32::from(generation));
        self.0.hw.borrow_mut().ram[place][0] = u32::from(generation);
        self.point("fills the upper half");
        // The compiler may delay the store to the upper half until the next fence.
        self.0.hw.borrow_mut().held_back[place] = Some(u32::from(generation));
        self.0.generation.set(generation);
        outbox.publish();
        self.forget_all_but(("published", received));
    }

    pub(super) fn scrub(&self) {
        for found in [scrub_waiting(RotationOf(self.clone())), scrub_waiting(self.clone())] {
            self.0.telemetry.scrubbed(found);
        }
        self.call(|called| called.ssi = true);
        self.interrupts();
    }
}
