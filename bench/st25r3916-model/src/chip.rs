//! The chip.
use crate::{AirEvent, Config, Report};

/// One ST25R3916 or ST25R3916B on a virtual clock.
#[derive(Clone, Debug)]
pub struct Chip {
    config: Config,
    now: u64,
    reports: Vec<Report>,
    air: Vec<(u64, AirEvent)>,
}

impl Chip {
    /// A chip that is powered from time 0.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            now: 0,
            reports: Vec::new(),
            air: Vec::new(),
        }
    }
    /// Its configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }
    /// Supply on: every register takes its reset value.
    pub fn power_on(&mut self, now: u64) {
        self.advance(now);
    }
    /// Supply off: field, IRQ pin and MISO go low, registers are lost.
    pub fn power_off(&mut self, now: u64) {
        self.advance(now);
    }
    /// Chip select goes low.
    pub fn select(&mut self, now: u64) {
        self.advance(now);
    }
    /// Eight clocks: `mosi` has been shifted in at `now`; returns what was shifted out.
    pub fn transfer(&mut self, now: u64, _mosi: u8) -> u8 {
        self.advance(now);
        0
    }
    /// Chip select goes high.
    pub fn deselect(&mut self, now: u64) {
        self.advance(now);
    }
    /// The SPI clock the controller uses, Hz; above 10 MHz is reported.
    pub fn spi_clock_hz(&mut self, _hz: u32) {}
    /// Level of the IRQ pin at the time last advanced to.
    pub fn irq(&self) -> bool {
        false
    }
    /// When the chip next does something by itself, ns; never before the time last advanced to.
    pub fn next_event(&self) -> Option<u64> {
        None
    }
    /// Lets every internal event up to and including `now` take effect.
    pub fn advance(&mut self, now: u64) {
        self.now = self.now.max(now);
    }
    /// Whether there is anything for [`Chip::take_air`].
    pub fn has_air(&self) -> bool {
        !self.air.is_empty()
    }
    /// What the chip has emitted since the last call, in order of time.
    pub fn take_air(&mut self) -> impl Iterator<Item = (u64, AirEvent)> + '_ {
        self.air.drain(..)
    }
    /// Something happens on the air at `at` (may lie ahead; what lies behind counts as now).
    pub fn hear(&mut self, _at: u64, _event: &AirEvent) {}
    /// What must not be passed over in silence.
    pub fn reports(&self) -> &[Report] {
        &self.reports
    }
}
