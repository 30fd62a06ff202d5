//! Reset and clock control, RM0090 chapter 6: rigless's model with an oscillator that can be absent and can fail.
//!
//! | covered | RM0090 |
//! |---|---|
//! | HSE without a source: `HSEON` stays set, `HSERDY` clear, a PLL fed from it does not lock | 6.2.1, 6.2.3 |
//! | a switch to a source that never gets ready waits for ever | 6.2.6 |
//! | HSE failing with `CSSON`: HSE off; where it clocked the system, HSI instead and the PLL off | 6.2.7 |
//! | the same: `CSSF`, the NMI that stands until `CSSC` is written, the break of TIM1 and TIM8 | 6.2.7 |
//! | HSE failing without `CSSON`: what it clocked has no clock; a core on it stands still | 6.2.7 |
//! | HSI off its 16 MHz, in everything that is clocked from it | 6.2.2 |
//!
//! | left out | why |
//! |---|---|
//! | how long the detector and a PLL losing its lock take | no figure is given for either; here no time |
//! | the core timer's rate, which rigless gives one value for good | see [`super::Oscillators::systick_hz`] |

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::Bus;
use rigless::soc::stm32f427::generated::rcc::{REGISTERS, Register, cr, pllcfgr};
use rigless::soc::stm32f427::peripherals::rcc::{self, Apb, Rcc};
use rigless::time::EventId;

/// `SWS`, bits 3:2 of `CFGR`, as HSI and the PLL read there, 6.3.3.
const SWS_HSI: u64 = 0;
const SWS_PLL: u64 = 2;
/// `CIR.CSSF`, 6.3.4.
const CSSF: u64 = 1 << 7;

/// Where a clock output's rate comes from.
#[derive(Clone, Copy, Debug)]
enum Domain {
    Hclk,
    Pclk1,
    Pclk2,
    Timers1,
    Timers2,
    Pll48,
}

/// One clock output that follows the system clock, and the bit that lets it through.
#[derive(Clone, Copy, Debug)]
struct Output {
    number: usize,
    domain: Domain,
    enable: Option<(Register, u64)>,
    /// What it carries with HSI at exactly 16 MHz.
    nominal: u64,
}

/// The peripheral.
#[derive(Debug)]
pub(super) struct ClockControl {
    rcc: Rcc,
    /// Whether OSC_IN carries a clock.
    hse: bool,
    hsi_ppb: i64,
    outputs: Vec<Output>,
}

impl ClockControl {
    /// Takes over from `rcc`, which `bus` was described with.
    pub(super) fn new(rcc: Rcc, bus: &Bus, hse: bool, hsi_ppb: i64) -> Self {
        let mut outputs: Vec<Output> = [
            (rcc::HCLK, Domain::Hclk),
            (rcc::PCLK1, Domain::Pclk1),
            (rcc::PCLK2, Domain::Pclk2),
            (rcc::APB1_TIMERS, Domain::Timers1),
            (rcc::APB2_TIMERS, Domain::Timers2),
            (rcc::PLL48, Domain::Pll48),
        ]
        .map(|(number, domain)| Output { number, domain, enable: None, nominal: 0 })
        .into();
        for slot in bus.slots() {
            let name = slot.peripheral().name;
            let Some(clock) = bus.clock_of(name).filter(|clock| clock.instance == "RCC") else { continue };
            let common = outputs.iter().any(|output| output.number == clock.output) || clock.output == rcc::IWDG_CLK;
            if let Some((register, mask)) = enable_of(name).filter(|_| !common) {
                let on_apb1 = matches!(register, Register::Apb1enr);
                let domain = match (name, on_apb1) {
                    ("SDIO", _) => Domain::Pll48,
                    (name, true) if name.starts_with("TIM") => Domain::Timers1,
                    (name, false) if name.starts_with("TIM") => Domain::Timers2,
                    (_, true) => Domain::Pclk1,
                    (_, false) => Domain::Pclk2,
                };
                outputs.push(Output { number: clock.output, domain, enable: Some((register, mask)), nominal: 0 });
            }
        }
        Self { rcc, hse, hsi_ppb, outputs }
    }

    /// The part was rebuilt by a reset and `rcc` with it, which holds the reset flags.
    pub(super) fn restarted(&mut self, rcc: &mut Rcc) {
        std::mem::swap(&mut self.rcc, rcc);
        for output in &mut self.outputs {
            output.nominal = 0;
        }
    }

    /// Takes the flags in `registers` for its own, and drives every clock as it is out of reset.
    pub(super) fn take_over(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let value = registers.get(Register::Ahb1lpenr);
        self.call(registers, context, |rcc, registers, context| {
            Device::write(rcc, Register::Ahb1lpenr, value, registers, context);
        });
    }

    /// Calls rigless's model, which takes any HSE that is switched on for one that starts.
    fn call(
        &mut self,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
        call: impl FnOnce(&mut Rcc, &mut RegisterFile, &mut DeviceContext<'_>),
    ) {
        let on = registers.get(Register::Cr) & cr::HSEON.mask();
        if !self.hse {
            registers.set(Register::Cr, registers.get(Register::Cr) & !cr::HSEON.mask());
        }
        call(&mut self.rcc, registers, context);
        if !self.hse {
            registers.set(Register::Cr, registers.get(Register::Cr) | on);
        }
        self.drive_deviating(registers, context);
    }

    /// Whether OSC_IN carries a clock.
    pub(super) fn hse(&self) -> bool {
        self.hse
    }

    /// HSE stops.
    pub(super) fn fail_hse(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if !self.hse {
            return;
        }
        let control = registers.get(Register::Cr);
        if cr::CSSON.is_set(control) {
            self.call(registers, context, Rcc::fail_hse);
        } else if cr::HSERDY.is_set(control) {
            registers.set(Register::Cr, cr::HSERDY.set(control, 0));
        }
        self.hse = false;
        self.look_at_control(registers, context);
    }

    /// HSE oscillates again; software that waits for `HSERDY` sees it.
    pub(super) fn restore_hse(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.hse = true;
        self.look_at_control(registers, context);
    }

    /// Starts and stops what `CR` asks for with the oscillators as they are now.
    fn look_at_control(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let value = registers.get(Register::Cr);
        self.call(registers, context, |rcc, registers, context| {
            Device::write(rcc, Register::Cr, value, registers, context);
        });
    }

    /// The NMI line, which stands while `CSSF` does.
    pub(super) fn nmi(registers: &RegisterFile) -> bool {
        registers.get(Register::Cir) & CSSF != 0
    }

    /// Whether the system clock comes from HSI, directly or through the PLL.
    fn on_hsi(registers: &RegisterFile) -> bool {
        let from = registers.get(Register::Cfgr) >> 2 & 0b11;
        from == SWS_HSI || from == SWS_PLL && !pllcfgr::PLLSRC.is_set(registers.get(Register::Pllcfgr))
    }

    fn deviate(&self, hz: u64) -> u64 {
        let hz = u128::from(hz) * u128::from(1_000_000_000_u64.saturating_add_signed(self.hsi_ppb));
        u64::try_from((hz + 500_000_000) / 1_000_000_000).unwrap_or(u64::MAX)
    }

    fn real(&self, hz: u64, registers: &RegisterFile) -> u64 {
        if Self::on_hsi(registers) { self.deviate(hz) } else { hz }
    }

    /// HCLK, in hertz; zero where its source does not run.
    pub(super) fn hclk(&self, registers: &RegisterFile) -> u64 {
        self.real(self.rcc.hclk(registers), registers)
    }

    /// PCLK1, in hertz.
    pub(super) fn pclk1(&self, registers: &RegisterFile) -> u64 {
        self.real(self.rcc.pclk1(registers), registers)
    }

    /// What the timers on `apb` count, in hertz.
    pub(super) fn timer_clock(&self, registers: &RegisterFile, apb: Apb) -> u64 {
        self.real(self.rcc.timer_clock(registers, apb), registers)
    }

    /// rigless's model has just driven whatever changed, HSI at 16 MHz exactly: drives what it really carries after it.
    fn drive_deviating(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        if self.hsi_ppb == 0 {
            return;
        }
        for nth in 0..self.outputs.len() {
            let Output { number, domain, enable, nominal } = self.outputs[nth];
            let open = enable.is_none_or(|(register, mask)| registers.get(register) & mask != 0);
            let hz = match domain {
                _ if !open => 0,
                Domain::Hclk => self.rcc.hclk(registers),
                Domain::Pclk1 => self.rcc.pclk1(registers),
                Domain::Pclk2 => self.rcc.pclk2(registers),
                Domain::Timers1 => self.rcc.timer_clock(registers, Apb::One),
                Domain::Timers2 => self.rcc.timer_clock(registers, Apb::Two),
                Domain::Pll48 => self.rcc.pll48(registers),
            };
            if hz != nominal {
                self.outputs[nth].nominal = hz;
                let by_hsi = match domain {
                    Domain::Pll48 => !pllcfgr::PLLSRC.is_set(registers.get(Register::Pllcfgr)),
                    _ => Self::on_hsi(registers),
                };
                context.clock(number, if by_hsi { self.deviate(hz) } else { hz });
            }
        }
    }
}

/// The register and mask of the bit that clocks the peripheral called `name`, 6.3.10 to 6.3.14: its name with `EN`
/// after it.
fn enable_of(name: &str) -> Option<(Register, u64)> {
    [Register::Ahb1enr, Register::Apb1enr, Register::Apb2enr].into_iter().find_map(|register| {
        let spec = REGISTERS.iter().find(|spec| {
            spec.name
                == match register {
                    Register::Ahb1enr => "AHB1ENR",
                    Register::Apb1enr => "APB1ENR",
                    _ => "APB2ENR",
                }
        })?;
        // UART7 and UART8 have an R behind in the vendor's description.
        let field = spec
            .fields
            .iter()
            .find(|field| field.name.strip_prefix(name).is_some_and(|rest| rest == "EN" || rest == "ENR"))?;
        Some((register, field.mask()))
    })
}

impl Device for ClockControl {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.call(registers, context, |rcc, registers, context| {
            Device::write(rcc, register, value, registers, context);
        });
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.call(registers, context, |rcc, registers, context| Device::on_event(rcc, event, registers, context));
    }

    fn on_request(&mut self, change: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.call(registers, context, |rcc, registers, context| Device::on_request(rcc, change, registers, context));
    }
}
