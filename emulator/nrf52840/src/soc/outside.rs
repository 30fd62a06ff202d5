//! Everything that crosses the pins: levels, bytes of SPIM and SPIS, the controller of a TWIS, UART frames.

use super::*;

impl Soc {
    pub(super) fn with_gpiote(&mut self, call: impl FnOnce(&mut Gpiote, &mut Cx<'_>)) {
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << GPIOTE;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: GPIOTE, name: "GPIOTE" };
        call(&mut parts.gpiote, &mut cx);
    }

    pub(crate) fn drive<O: Outside>(&mut self, at: Cycle, pin: Pin, level: Option<bool>, outside: &mut O) {
        self.come(at, outside);
        // The core's last access may be a few cycles after the edge, because the instruction of that access began
        // before the edge. The edge still takes effect at its own instant.
        let reached = std::mem::replace(&mut self.now, at);
        self.gpio.outside(pin, level, at, &mut self.out);
        self.carry(outside);
        self.now = self.now.max(reached);
    }

    pub(super) fn come<O: Outside>(&mut self, at: Cycle, outside: &mut O) {
        self.advance(at, outside);
        self.out.pc = None;
    }

    /// Tells a pin's new level to the instances that use the pin. In System OFF only SENSE reacts.
    pub(super) fn level(&mut self, pin: Pin, level: bool) {
        if self.halted {
            return;
        }
        if self.parts.gpiote.watches(pin) && self.gpio.is_connected(pin) {
            self.with_gpiote(|gpiote, cx| gpiote.pad(pin, level, cx));
        }
        for (number, id) in UARTE_IDS.into_iter().enumerate() {
            if self.parts.uarte[number].clear_to_send() == Some(pin) {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.uarte[number].clear_to_send_moved(level, &mut cx);
            }
        }
        for (number, id) in SPIS_IDS.into_iter().enumerate() {
            if self.parts.serial[number].csn() == Some(pin) {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.serial[number].csn_moved(level, &mut cx);
            }
        }
    }

    pub(super) fn exchange<O: Outside>(&mut self, id: Id, mosi: u8, begins: Cycle, outside: &mut O) {
        let number = serial_number(id);
        let wires = self.parts.serial[number].wires();
        let gpio = &self.gpio;
        let output = |pin: Option<Pin>| pin.filter(|&pin| gpio.is_output(pin));
        let (sck, mosi_pin) = (output(wires.sck), output(wires.mosi));
        let frame = SpiFrame {
            sck: [sck.map(Pin::named), None],
            mosi: [mosi_pin.map(Pin::named), None],
            miso: wires.miso.map(Pin::named),
            mode: wires.mode,
            bits: 8,
            data: u32::from(mosi),
            begins,
            ends: self.now,
        };
        let answer = outside.spi(&frame);
        let miso = match wires.miso {
            Some(pin) if self.gpio.is_connected(pin) => match answer {
                Some(bits) if !self.gpio.is_output(pin) => bits as u8,
                // No device drives MISO, so the line has the level to which its pad pulls it.
                _ => 0xFF * u8::from(self.gpio.level(pin)),
            },
            _ => 0,
        };
        for (wanted, has) in [(wires.sck, sck), (wires.mosi, mosi_pin)] {
            if wanted != has {
                let what = "SCK or MOSI of SPIM is no output and carries nothing, pin";
                self.find(FindingKind::Misuse, name_of(id), what, wanted.map_or(0, |pin| pin.index() as u32));
            }
        }
        if let Some(pin) = wires.miso
            && (!self.gpio.is_connected(pin) || self.gpio.is_output(pin))
        {
            let what = "MISO of SPIM is no connected input, pin";
            self.find(FindingKind::Misuse, name_of(id), what, pin.index() as u32);
        }
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << id;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
        parts.serial[number].exchanged(miso, &mut cx);
    }

    pub(crate) fn spis_select<O: Outside>(&mut self, at: Cycle, csn: Pin, outside: &mut O) {
        if !self.gpio.is_driven_from_outside(csn) {
            self.drive(at, csn, Some(true), outside);
        }
        self.drive(at, csn, Some(false), outside);
    }

    /// Passes a byte that an SPI controller has clocked until `at` on to the SPIS. The caller delivers the effects.
    fn spis_byte(&mut self, at: Cycle, mosi: u8, mode: SpiMode) -> Option<u8> {
        let wires = self.spis_wires?;
        let selected = |number: &usize| {
            let serial = &self.parts.serial[*number];
            serial.selected() && serial.csn().is_some_and(|csn| csn.named() == wires.csn)
        };
        let number = (0..SPIS_IDS.len()).find(selected)?;
        let id = SPIS_IDS[number];
        let Soc { parts, clocks, out, touched, memory, gpio, .. } = self;
        *touched |= 1 << id;
        let mut cx = Cx { now: at, clocks, memory, pins: gpio, out, id, name: name_of(id) };
        parts.serial[number].clock(&wires, mosi, mode, &mut cx)
    }

    pub(crate) fn spis_clock<O: Outside>(&mut self, at: Cycle, mosi: u8, mode: SpiMode, outside: &mut O) -> Option<u8> {
        self.come(at, outside);
        let miso = self.spis_byte(self.now, mosi, mode);
        self.carry(outside);
        miso
    }

    /// Exchanges several bytes. The first byte ended at `first`. The bytes are `time` apart, in units of 2⁻¹⁶ cycles.
    pub(crate) fn spis_exchange<O: Outside>(
        &mut self,
        first: Cycle,
        time: u64,
        mode: SpiMode,
        mosi: &[u8],
        miso: &mut [u8],
        outside: &mut O,
    ) -> bool {
        let later = time.saturating_mul(mosi.len().saturating_sub(1) as u64) >> 16;
        self.come(first + later, outside);
        let mut driven = true;
        let mut past = 0;
        for (&sent, got) in mosi.iter().zip(miso) {
            let answer = self.spis_byte(first + (past >> 16), sent, mode);
            driven &= answer.is_some();
            *got = answer.unwrap_or(0xFF);
            past += time;
        }
        self.carry(outside);
        driven
    }

    pub(crate) fn spis_quiet(&self) -> usize {
        let selected = self.parts.serial[..3].iter().filter(|serial| serial.selected());
        selected.map(Serial::quiet).min().unwrap_or(usize::MAX)
    }

    pub(crate) fn two_wire<O: Outside>(
        &mut self,
        at: Cycle,
        [scl, sda]: [Pin; 2],
        event: I2cEvent,
        outside: &mut O,
    ) -> Option<I2cAnswer> {
        self.come(at, outside);
        let mut answer = Some(I2cAnswer::NOBODY);
        let is_target = |number: &usize| self.parts.serial[*number].is_target_on(scl, sda);
        let connected = self.gpio.is_connected(scl) && self.gpio.is_connected(sda);
        if let Some(number) = (0..SPIS_IDS.len()).find(is_target) {
            let id = SPIS_IDS[number];
            let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
            *touched |= 1 << id;
            let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
            if connected {
                answer = parts.serial[number].target_heard(event, &mut cx);
            } else {
                cx.misuse("SCL or SDA of TWIS is no connected input; PSEL.SCL", scl.index() as u32);
            }
        }
        self.carry(outside);
        answer
    }

    pub(crate) fn uart_receive<O: Outside>(&mut self, begins: Cycle, pin: Pin, frame: UartFrame, outside: &mut O) {
        self.come(begins, outside);
        for (n, id) in UARTE_IDS.into_iter().enumerate() {
            if self.parts.uarte[n].listens_to(pin) {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.uarte[n].receive(begins, frame, &mut cx);
            }
        }
        self.carry(outside);
    }
}
