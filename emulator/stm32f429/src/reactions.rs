//! The consequences of calling an instance: interrupt lines, DMA requests, pins, triggers, the next event.

use super::*;

impl Stm32f429 {
    pub(crate) fn refresh(&mut self, number: u8) {
        let (irq, dma, due) = with!(self, number, p => (p.irq(), p.dma(), p.due()));
        // A frame may reach an instance late, and its event may then be due in the past. Such an event is handled now.
        self.set_due(number, due.max(self.now));
        let at = usize::from(number);
        self.requests[at] = dma as u8;
        self.set_hungry(at);
        self.set_irq(number, irq);
    }

    #[inline]
    pub(crate) fn set_hungry(&mut self, at: usize) {
        if self.requests[at] & self.listened[at] != 0 {
            self.hungry |= 1 << at;
        } else {
            self.hungry &= !(1 << at);
        }
    }

    #[inline]
    pub(crate) fn set_due(&mut self, number: u8, due: Cycle) {
        let at = usize::from(number);
        if std::mem::replace(&mut self.due[at], due) == due {
            return;
        }
        let group = at / 8;
        let earliest = |list: &[Cycle]| list.iter().fold(NEVER, |least, &due| least.min(due));
        self.group_due[group] = earliest(&self.due[group * 8..group * 8 + 8]);
        let next = earliest(&self.group_due);
        if next != self.next {
            self.next = next;
            self.signals.announce_due();
        }
    }

    pub(crate) fn first_due(&self, at: Cycle) -> u8 {
        let position = |list: &[Cycle]| list.iter().position(|&due| due == at).unwrap_or(0);
        let group = position(&self.group_due);
        (group * 8 + position(&self.due[group * 8..group * 8 + 8])) as u8
    }

    /// Drives the interrupt lines of an instance, RM0090 table 63.
    pub(crate) fn set_irq(&mut self, number: u8, irq: u32) {
        const SPI: [u8; 6] = [35, 36, 51, 84, 85, 86];
        const USART: [u8; 8] = [37, 38, 39, 52, 53, 71, 82, 83];
        const I2C: [u8; 3] = [31, 33, 72];
        // TIM2 to TIM7
        const TIM: [u8; 6] = [28, 29, 30, 50, 54, 55];
        // TIM9 to TIM14
        const SHARED: [u8; 6] = [24, 25, 26, 43, 44, 45];
        match number {
            id::SPI..id::USART => self.set_line(SPI[usize::from(number - id::SPI)], irq & 1 != 0),
            id::USART..id::I2C => self.set_line(USART[usize::from(number - id::USART)], irq & 1 != 0),
            id::I2C..id::TIM => {
                let line = I2C[usize::from(number - id::I2C)];
                self.set_line(line, irq & 1 != 0);
                self.set_line(line + 1, irq & 2 != 0);
            }
            id::TIM..id::RTC => match number - id::TIM + 1 {
                n @ (1 | 8) => {
                    let first = if n == 1 { 24 } else { 43 };
                    for nth in 0..4 {
                        self.set_line(first + nth, irq >> nth & 1 != 0);
                    }
                }
                n @ 2..=7 => self.set_line(TIM[usize::from(n - 2)], irq & 1 != 0),
                n => {
                    let line = SHARED[usize::from(n - 9)];
                    let bit = 1_u64 << line;
                    self.shared[0] = self.shared[0] & !bit | if irq & 1 != 0 { bit } else { 0 };
                    self.show_lines();
                }
            },
            id::RTC => {
                let levels = (irq & 1) << 17 | (irq >> 1 & 1) << 21 | (irq >> 2 & 1) << 22;
                self.exti.sample(1 << 17 | 1 << 21 | 1 << 22, levels);
                self.after_exti();
            }
            id::RNG => self.set_line(80, irq & 1 != 0),
            id::ADC => self.set_line(18, irq & 1 != 0),
            id::CAN1 => {
                for nth in 0..3 {
                    self.set_line(19 + nth, irq >> nth & 1 != 0);
                }
            }
            _ => {}
        }
    }

    #[inline]
    pub(crate) fn set_line(&mut self, line: u8, high: bool) {
        let (word, bit) = (usize::from(line / 64), 1_u64 << (line % 64));
        if (self.own[word] & bit != 0) != high {
            self.own[word] ^= bit;
            self.show_lines();
        }
    }

    pub(crate) fn show_lines(&mut self) {
        for word in 0..2 {
            self.signals.drive_lines(word, self.own[word] | self.shared[word]);
        }
    }

    pub(crate) fn after_exti(&mut self) {
        let live = self.exti.live();
        for line in 0..5 {
            self.set_line(6 + line, live >> line & 1 != 0);
        }
        self.set_line(23, live & 0x0000_03E0 != 0);
        self.set_line(40, live & 0x0000_FC00 != 0);
        for (line, interrupt) in [(16, 1), (17, 41), (18, 42), (19, 62), (20, 76), (21, 2), (22, 3)] {
            self.set_line(interrupt, live >> line & 1 != 0);
        }
        if std::mem::take(&mut self.exti.events) != 0 {
            self.signals.raise_event();
        }
        let edges = std::mem::take(&mut self.exti.edges);
        for line in [11, 15] {
            if edges >> line & 1 != 0 {
                self.out.triggers.push(Trigger::Exti(line));
            }
        }
    }

    pub(crate) fn after_dma(&mut self, controller: usize) {
        const LINES: [[u8; 8]; 2] = [[11, 12, 13, 14, 15, 16, 17, 47], [56, 57, 58, 59, 60, 68, 69, 70]];
        for (nth, line) in LINES[controller].into_iter().enumerate() {
            let irq = self.dma[controller].streams[nth].irq();
            self.set_line(line, irq);
        }
    }

    /// Determines, for each instance, which of its requests are served by streams.
    pub(crate) fn listen(&mut self) {
        self.listened = [0; id::SCHEDULED];
        for (dma, listening) in self.dma.iter().zip(&mut self.listening) {
            *listening = 0;
            for (nth, stream) in dma.streams.iter().enumerate() {
                let (instance, mask) = stream.source;
                self.listened[usize::from(instance)] |= mask;
                *listening |= u8::from(mask != 0) << nth;
            }
        }
        self.hungry = 0;
        for at in 0..usize::from(id::INSTANCES) {
            self.set_hungry(at);
        }
        self.pair_streams();
    }

    /// Passes a possible change of the clock tree on to the instances.
    pub(crate) fn after_rcc<O: Outside>(&mut self, now: Cycle, pc: Option<u32>, outside: &mut O) {
        self.set_line(5, self.rcc.irq());
        self.signals.drive_nmi(self.rcc.nmi());
        if self.rcc.reset_bits != [0; 5] {
            self.reset_peripherals(now);
        }
        if std::mem::take(&mut self.rcc.backup_reset) {
            self.rtc.reset();
            self.dirty |= 1 << id::RTC;
        }
        if std::mem::take(&mut self.rcc.clocks_changed) {
            let old = std::mem::replace(&mut self.clocks, self.rcc.clocks);
            let new = self.clocks;
            self.iwdg.clocks_changed(now, &old, &new);
            self.wwdg.clocks_changed(now, &old, &new);
            self.flash.clocks_changed(now, old.hclk_hz, new.hclk_hz);
            for number in 0..id::INSTANCES {
                with!(self, number, p => p.clocks_changed(&old, cx!(self, number, now, pc)));
            }
            self.dirty |= (1 << id::INSTANCES) - 1;
            self.check_flash(now, pc);
            self.signals.announce();
        }
        self.set_due(id::RCC, self.rcc.due());
        self.set_due(id::IWDG, self.iwdg.due());
        self.set_due(id::WWDG, self.wwdg.due());
        self.set_due(id::FLASH, self.flash.due());
        self.settle(now, outside);
    }

    pub(crate) fn check_flash(&mut self, now: Cycle, pc: Option<u32>) {
        if self.flash.check(self.rcc.clocks.hclk_hz, self.supply.microvolts(), now, pc, &mut self.out) {
            self.signals.forget_code();
        }
    }

    /// Updates the voltage detector.
    pub(crate) fn watch_supply(&mut self) {
        self.supply.detect(self.pwr.cr());
        self.exti.sample(1 << 16, u32::from(self.supply.low) << 16);
        self.after_exti();
    }

    pub(crate) fn reset_peripherals(&mut self, now: Cycle) {
        let bits = std::mem::take(&mut self.rcc.reset_bits);
        for number in 0..id::COUNT as u8 {
            let gate = id::GATES[usize::from(number)];
            if gate.bus == 255 || bits[usize::from(gate.bus)] >> gate.bit & 1 == 0 {
                continue;
            }
            match number {
                ..id::INSTANCES => {
                    with!(self, number, p => p.reset());
                    self.gpio.release(signals_of(number), now, &mut self.out);
                    self.dirty |= 1 << number;
                }
                // Only a system reset stops the independent watchdog.
                id::IWDG => {}
                id::WWDG => {
                    self.wwdg = Wwdg::new();
                    self.set_line(0, false);
                    self.set_due(id::WWDG, NEVER);
                }
                id::DMA1 | id::DMA2 => {
                    let nth = usize::from(number - id::DMA1);
                    self.dma[nth] = Dma::new(nth);
                    self.after_dma(nth);
                    self.listen();
                }
                id::PWR => {
                    self.pwr = Pwr::new();
                    self.watch_supply();
                }
                id::SYSCFG => self.syscfg = Syscfg::default(),
                id::DAC => {
                    self.dac = Dac::default();
                    self.gpio.pads.dac = [None; 2];
                }
                id::GPIO..id::BKPSRAM => {
                    let port = usize::from(number - id::GPIO);
                    self.gpio.reset_port(port);
                    self.gpio.settle(port, now, None, &mut self.out);
                }
                _ => {}
            }
        }
    }

    pub(crate) fn refresh_all(&mut self) {
        for number in 0..id::INSTANCES {
            self.refresh(number);
        }
        self.set_due(id::RCC, self.rcc.due());
        self.set_due(id::IWDG, self.iwdg.due());
        self.set_due(id::WWDG, self.wwdg.due());
        self.set_due(id::FLASH, self.flash.due());
        self.set_due(id::DMA1, NEVER);
        self.listen();
    }

    /// Carries out everything that a call has set off: interrupt lines, pins, triggers, DMA.
    #[inline]
    pub(crate) fn settle<O: Outside>(&mut self, now: Cycle, outside: &mut O) {
        let (mut transfers, mut rounds) = ([0; 2], 0);
        loop {
            if !self.out.triggers.is_empty() {
                rounds += 1;
                if rounds > MOST_TRIGGERS {
                    self.out.triggers.clear();
                    self.find(
                        FindingKind::Unmodelled,
                        None,
                        "TIM",
                        "timers trigger one another without end, rounds",
                        rounds,
                    );
                }
            }
            while self.dirty != 0 {
                let number = self.dirty.trailing_zeros() as u8;
                self.dirty &= self.dirty - 1;
                self.refresh(number);
            }
            if self.drain(now, outside) {
                continue;
            }
            if self.hungry == 0 {
                return;
            }
            let Some(nth) = self.transfer(now) else {
                if self.hungry != 0 {
                    let [first, second] = self.dma_pauses_until.map(|until| if until > now { until } else { NEVER });
                    self.set_due(id::DMA1, first.min(second));
                }
                return;
            };
            transfers[nth] += 1;
            if transfers[nth] == MOST_TRANSFERS {
                self.dma_pauses_until[nth] = now + Cycle::from(MOST_TRANSFERS) * TRANSFER_CYCLES;
            }
        }
    }

    /// Passes on effects of instances and ports. Returns whether there were any.
    #[inline]
    pub(crate) fn drain<O: Outside>(&mut self, now: Cycle, outside: &mut O) -> bool {
        if self.out.notes.is_empty()
            && self.out.outputs.is_empty()
            && self.out.triggers.is_empty()
            && self.gpio.changed.is_empty()
            && self.gpio.levels_changed.is_empty()
            && self.gpio.inputs.is_empty()
        {
            return false;
        }
        while let Some(note) = self.out.notes.pop() {
            self.note(note);
        }
        let mut outputs = std::mem::take(&mut self.out.outputs);
        for (at, signal, level) in outputs.drain(..) {
            self.gpio.signal(signal, level, at, &mut self.out);
            self.tell_pins(at, outside);
        }
        if self.out.outputs.is_empty() {
            self.out.outputs = outputs;
        }
        self.tell_pins(now, outside);
        let mut levels = std::mem::take(&mut self.gpio.levels_changed);
        for (port, mask) in levels.drain(..) {
            self.sample_port(usize::from(port), mask);
        }
        self.gpio.levels_changed = levels;
        let mut inputs = std::mem::take(&mut self.gpio.inputs);
        for (signal, level) in inputs.drain(..) {
            if let Some(number) = instance_of(signal) {
                with!(self, number, p => p.input(signal, level, cx!(self, number, now, None)));
                self.dirty |= 1 << number;
            }
        }
        self.gpio.inputs = inputs;
        let mut triggers = std::mem::take(&mut self.out.triggers);
        for trigger in triggers.drain(..) {
            for number in (id::TIM..id::RTC).chain([id::ADC]) {
                with!(self, number, p => p.trigger(trigger, cx!(self, number, now, None)));
                self.dirty |= 1 << number;
            }
        }
        if self.out.triggers.is_empty() {
            self.out.triggers = triggers;
        }
        true
    }

    pub(crate) fn tell_pins<O: Outside>(&mut self, at: Cycle, outside: &mut O) {
        for (pin, pad) in self.gpio.changed.drain(..) {
            outside.pin(at, pin, pad);
        }
    }

    pub(crate) fn sample_port(&mut self, port: usize, mut mask: u16) {
        let mut lines = 0;
        while mask != 0 {
            let line = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if self.syscfg.port_of(line) == port {
                lines |= 1 << line;
            }
        }
        if lines != 0 {
            self.exti.sample(lines, u32::from(self.gpio.pads.levels[port]));
            self.after_exti();
        }
    }
}
