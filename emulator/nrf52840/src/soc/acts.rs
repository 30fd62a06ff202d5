//! Time, and the queue of effects: events, tasks, pads, conversions (PS 6.1, 6.16).

use super::*;

/// The maximum number of acts that one access or one instant may set off. Only an endless loop sets off more.
const LOOP_LIMIT: u32 = 100_000;

impl Soc {
    pub(crate) fn advance<O: Outside>(&mut self, to: Cycle, outside: &mut O) {
        while self.next <= to {
            self.now = self.now.max(self.next);
            self.out.pc = None;
            self.fire(outside);
            self.carry(outside);
        }
        self.now = self.now.max(to);
    }

    fn fire<O: Outside>(&mut self, outside: &mut O) {
        // Only LPCOMP works in System OFF.
        let there = if self.off { 1 << COMP } else { u64::MAX };
        let mut later = u64::MAX;
        loop {
            // An event of one instance may have called another instance, and that one may now have an event due as
            // well.
            let left = (self.scheduled | self.touched) & later & there;
            if left == 0 {
                return;
            }
            let id = left.trailing_zeros() as Id;
            later = u64::MAX << id << 1;
            if self.nexts[id] > self.now && self.touched >> id & 1 == 0 {
                continue;
            }
            let Self { parts, now, .. } = self;
            let due = instance!(parts, id, instance => instance.next().is_some_and(|at| at <= *now));
            if due == Some(true) {
                call!(self, id, instance, cx => instance.due(cx));
                // The effects of an instance are delivered before the next instance acts, even if both are due at one
                // instant.
                self.drain(outside);
            }
        }
    }

    pub(crate) fn carry<O: Outside>(&mut self, outside: &mut O) {
        self.drain(outside);
        self.look_at_touched();
        if self.memory.code_changed {
            self.memory.code_changed = false;
            self.signals.forget_code();
        }
    }

    #[inline]
    fn drain<O: Outside>(&mut self, outside: &mut O) {
        let mut turns = 0;
        while let Some(act) = self.out.acts.pop_front() {
            turns += 1;
            if turns > LOOP_LIMIT {
                self.find(FindingKind::Misuse, "PPI", "an event triggers itself without end; cut", LOOP_LIMIT);
                self.out.acts.clear();
                return;
            }
            self.perform(act, outside);
        }
    }

    /// Reads the interrupt line and the next event of each instance that was called since the last look.
    pub(super) fn look_at_touched(&mut self) {
        if self.touched == 0 {
            return;
        }
        let (was_next, mut least_moved) = (self.next, false);
        for id in ids(std::mem::take(&mut self.touched) & INSTANCES) {
            let parts = &mut self.parts;
            let state = instance!(parts, id, instance => (instance.line(), instance.next(), instance.moves()));
            let Some((high, next, moves)) = state else { continue };
            let next = next.unwrap_or(NEVER);
            let was = std::mem::replace(&mut self.nexts[id], next);
            least_moved |= was == self.next && next > was;
            self.next = self.next.min(next);
            let bit = 1 << id;
            self.scheduled = if next == NEVER { self.scheduled & !bit } else { self.scheduled | bit };
            self.moving = if moves { self.moving | bit } else { self.moving & !bit };
            if id < usize::from(INTERRUPT_LINES) {
                self.signals.drive_line(id, high);
            }
        }
        if least_moved {
            self.next = ids(self.scheduled).map(|id| self.nexts[id]).min().unwrap_or(NEVER);
        }
        if self.halted {
            let looks = self.off && self.restarting.is_none() && self.parts.comparator.looks_in_system_off();
            self.next = if looks { self.nexts[COMP] } else { NEVER };
        }
        if self.next != was_next {
            self.signals.announce_due();
        }
    }

    fn perform<O: Outside>(&mut self, act: Act, outside: &mut O) {
        match act {
            Act::Event(address) if self.off => {
                if self.parts.comparator.detects_by(address) {
                    self.request(Reset::Wakeup(BY_LPCOMP));
                }
            }
            Act::Event(address) => self.parts.ppi.route(address, &mut self.out.acts),
            Act::Task(address) => {
                let (id, offset) = ((address >> 12 & 0x3F) as Id, address & 0xFFF);
                let on_the_bus = address >> 18 == 0x4000_0000 >> 18;
                let done = on_the_bus
                    && offset < 0x100
                    && call!(self, id, instance, cx => instance.task(offset, cx)) == Some(true);
                if !done {
                    let what = "a channel triggers a task that is not modelled or none at all, at";
                    self.find(FindingKind::Unmodelled, "PPI", what, address);
                }
            }
            Act::Exchange { id, mosi, begins } => self.exchange(id, mosi, begins, outside),
            Act::Hold { pin, level } => self.gpio.hold(pin, level, self.now, &mut self.out),
            Act::Level { pin, level } => self.level(pin, level),
            Act::Pad { pin, pad } => outside.pin(self.now, pin.named(), pad),
            Act::Sample { channel } => {
                let Self { parts, gpio, .. } = self;
                parts.gpiote.sample(channel, |pin| gpio.input(pin));
            }
            Act::Detect if self.off => self.request(Reset::Wakeup("System OFF")),
            Act::Detect => self.with_gpiote(Gpiote::port),
            Act::TwoWire { id, event } => {
                let number = serial_number(id);
                let [scl, sda] = self.parts.serial[number].two_wire_pins();
                let wired = |pin: Option<Pin>| pin.filter(|&pin| self.gpio.is_connected(pin));
                let answer = match (wired(scl), wired(sda)) {
                    (Some(scl), Some(sda)) => outside.i2c(self.now, scl.named(), sda.named(), event),
                    _ => {
                        self.find(
                            FindingKind::Misuse,
                            name_of(id),
                            "SCL or SDA is no connected input, block",
                            id as u32,
                        );
                        I2cAnswer::NOBODY
                    }
                };
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.serial[number].two_wire_answer(answer, &mut cx);
            }
            Act::Sent { pin, frame } => outside.uart(self.now, pin.named(), &frame),
            Act::Convert => {
                let now = self.now;
                let volts = |pin: Pin| outside.microvolts(now, pin.named());
                let Soc { parts, clocks, out, touched, memory, gpio, .. } = self;
                *touched |= 1 << SAADC;
                let mut cx = Cx { now, clocks, memory, pins: gpio, out, id: SAADC, name: "SAADC" };
                parts.saadc.convert(volts, &mut cx);
            }
            Act::Compare => {
                let now = self.now;
                let volts = |pin: Pin| outside.microvolts(now, pin.named());
                let Soc { parts, clocks, out, touched, memory, gpio, .. } = self;
                *touched |= 1 << COMP;
                let mut cx = Cx { now, clocks, memory, pins: gpio, out, id: COMP, name: "COMP/LPCOMP" };
                parts.comparator.look(volts, &mut cx);
            }
            Act::Spis { id, event } => {
                let number = serial_number(id);
                if event == SpisEvent::Ready {
                    self.spis_offers.push((self.now, self.parts.serial[number].offers(&self.memory)));
                }
                self.spis_events.push((self.now, number, event));
            }
            Act::Clock(source) => self.switch(source),
            Act::DemandLfclk => {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << CLOCK_POWER;
                let name = "CLOCK/POWER";
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: CLOCK_POWER, name };
                parts.clock_power.demand_lfclk(&mut cx);
            }
            Act::Restart => {
                self.watchdog_resets.push(WatchdogReset { at: self.now });
                self.request(Reset::Watchdog("WDT"));
            }
            Act::Off => {
                self.off = true;
                self.halted = true;
                self.touched |= 1;
                self.signals.stall_until(NEVER);
                if self.gpio.detects() {
                    self.request(Reset::Wakeup("System OFF"));
                }
            }
            Act::Stall(until) => self.signals.stall_until(self.signals.stalled_until().max(until)),
        }
    }

    /// Requests a restart. Nothing more happens in the part until then.
    fn request(&mut self, cause: Reset) {
        self.restarting = Some(cause);
        self.halted = true;
        self.touched |= 1;
        self.signals.stop();
    }
}
