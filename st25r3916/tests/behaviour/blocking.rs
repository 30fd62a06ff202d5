//! Tests the blocking form on `embedded-hal` traits, with the stand-in for the chip.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{ErrorType as PinErrorType, InputPin};
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use st25r3916::blocking::{Error, Listener, Poller};
use st25r3916::{Fault, FrameFlags, ListenerConfig, ListenerEvent, PollerConfig, Variant};

use crate::stand_in::{Chip, Miso};

#[derive(Clone)]
struct Shared(Rc<RefCell<Chip>>);

struct Spi(Shared, Rc<RefCell<bool>>);
struct Irq(Shared);
struct Delay(Shared);

impl ErrorType for Spi {
    type Error = ErrorKind;
}

impl SpiDevice for Spi {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        if *self.1.borrow() {
            return Err(ErrorKind::ModeFault);
        }
        let mut mosi = Vec::new();
        for operation in operations.iter() {
            match operation {
                Operation::Write(bytes) => mosi.extend_from_slice(bytes),
                Operation::Read(bytes) => mosi.extend(std::iter::repeat_n(0, bytes.len())),
                Operation::TransferInPlace(bytes) => mosi.extend_from_slice(bytes),
                _ => panic!("not used"),
            }
        }
        let miso = self.0.0.borrow_mut().transfer(&mosi);
        let mut rest = &miso[..];
        for operation in operations {
            let len = match operation {
                Operation::Write(bytes) => bytes.len(),
                Operation::Read(bytes) | Operation::TransferInPlace(bytes) => {
                    bytes.copy_from_slice(&rest[..bytes.len()]);
                    bytes.len()
                }
                _ => 0,
            };
            rest = &rest[len..];
        }
        Ok(())
    }
}

impl PinErrorType for Irq {
    type Error = Infallible;
}

impl InputPin for Irq {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.0.0.borrow().pin())
    }
    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!self.0.0.borrow().pin())
    }
}

impl DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) {
        let chip = &mut *self.0.0.borrow_mut();
        chip.advance(chip.now + u64::from(ns).div_ceil(1_000));
    }
}

fn wires(chip: Chip) -> (Shared, Rc<RefCell<bool>>, Spi, Irq, Delay) {
    let chip = Shared(Rc::new(RefCell::new(chip)));
    let broken = Rc::new(RefCell::new(false));
    (chip.clone(), broken.clone(), Spi(chip.clone(), broken), Irq(chip.clone()), Delay(chip))
}

#[test]
fn a_blocking_poller_sends_and_comes_back_in_time() {
    let (chip, _, spi, irq, delay) = wires(Chip::new(Variant::B));
    let mut poller = Poller::new(spi, irq, delay, PollerConfig::new());
    assert_eq!(poller.bring_up(), Ok(Variant::B));
    for len in [1, 124, 184, 244, 254] {
        let payload = vec![len as u8; len];
        let start = chip.0.borrow().now;
        assert_eq!(poller.send(&payload), Ok(()));
        assert_eq!(chip.0.borrow().sent.last().unwrap().1, payload);
        assert!(chip.0.borrow().now - start < 6_000);
    }
    assert_eq!(poller.send(&[]), Err(Error::Length));
    assert_eq!(poller.send(&[0; 255]), Err(Error::Length));
    assert_eq!(poller.counters().sent, 5);
    assert_eq!(chip.0.borrow().misuse, Vec::<String>::new());
}

#[test]
fn a_blocking_poller_tells_what_is_wrong_and_recovers() {
    let (chip, broken, spi, irq, delay) = wires(Chip::new(Variant::A));
    let mut poller = Poller::new(spi, irq, delay, PollerConfig::new());
    chip.0.borrow_mut().miso = Miso::StuckLow;
    assert_eq!(poller.bring_up(), Err(Error::Fault(Fault::Absent)));
    assert_eq!(poller.send(&[1; 20]), Err(Error::Fault(Fault::Absent)));
    chip.0.borrow_mut().miso = Miso::Driven;
    assert_eq!(poller.send(&[1; 20]), Ok(()));
    *broken.borrow_mut() = true;
    assert_eq!(poller.send(&[1; 20]), Err(Error::Spi(ErrorKind::ModeFault)));
    *broken.borrow_mut() = false;
    assert_eq!(poller.send(&[2; 20]), Ok(()));
    assert_eq!(chip.0.borrow().sent.last().unwrap().1, [2; 20]);
}

#[test]
fn a_blocking_listener_receives_and_returns_when_nothing_comes() {
    let (chip, broken, spi, irq, delay) = wires(Chip::new(Variant::B));
    let mut listener = Listener::new(spi, irq, delay, ListenerConfig::new());
    assert_eq!(listener.next(100_000), Ok(Some(ListenerEvent::Listening)));
    assert_eq!(listener.variant(), Some(Variant::B));

    let start = chip.0.borrow().now;
    assert_eq!(listener.next(7_000), Ok(None));
    let waited = chip.0.borrow().now - start;
    assert!((7_000..7_100).contains(&waited), "{waited}");

    for len in [124, 184, 244] {
        let now = chip.0.borrow().now;
        let payload = vec![len as u8; len];
        chip.0.borrow_mut().frame(now + 3_000, &payload);
        let mut calls = 0;
        let event = loop {
            calls += 1;
            if let Some(event) = listener.next(500).unwrap() {
                break event;
            }
        };
        assert!(calls > 3);
        assert_eq!(event, ListenerEvent::Frame { len, flags: FrameFlags::empty() });
        assert_eq!(listener.payload(len), payload);
    }

    *broken.borrow_mut() = true;
    assert_eq!(listener.next(100_000), Err(Error::Spi(ErrorKind::ModeFault)));
    *broken.borrow_mut() = false;
    assert_eq!(listener.next(100_000), Ok(Some(ListenerEvent::Listening)));
    assert_eq!(listener.counters().frames, 3);
    assert_eq!(chip.0.borrow().misuse, Vec::<String>::new());
}
