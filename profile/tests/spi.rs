//! Tests the client on an SPI device of embedded-hal 1.0, blocking and async.
use core::convert::Infallible;
use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation, SpiDevice};
use profile::criticality::{FlightController, Writer};
use profile::ssi::client::{AGE_UNKNOWN, Client, Config, Shown, Verdict, asynch, blocking};
use profile::ssi::timing::{CSN_HOLD_NS, CSN_SETUP_NS};
use profile::ssi::{self, Parsed, Request};
use profile::uplink::Written;
use profile::{Layout, LinkStatus, Profile, Uplink, UplinkValues};

use crate::support;

use support::seeds;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Broken;

impl Error for Broken {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

#[derive(Default)]
struct Dpr {
    map: Vec<u8>,
    window: Option<Request>,
    broken: bool,
    answered: u32,
}

impl Dpr {
    fn publish(&mut self, n: u32) {
        let mut values = seeds::link_values();
        values.timestamp = 5_000 + 10 * n;
        let link = LinkStatus::seal(&values);
        let profile = seeds::profile::<3>(10 * n);
        self.map = [link.as_bytes().as_slice(), profile.as_bytes(), &[0; 192]].concat();
    }

    fn answer(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Broken> {
        if self.broken {
            return Err(Broken);
        }
        let [Operation::DelayNs(CSN_SETUP_NS), Operation::TransferInPlace(bytes), Operation::DelayNs(CSN_HOLD_NS)] =
            operations
        else {
            panic!("chip select falls and rises in time: {operations:?}");
        };
        let window = self.window.map_or(0..self.map.len(), Request::window);
        let parsed = ssi::parse(bytes[..8].try_into().expect("eight bytes"), self.map.len());
        self.window = match parsed.expect("a good request") {
            Parsed::Window(window) => Some(window),
            Parsed::Nothing => None,
        };
        for (byte, shown) in bytes.iter_mut().zip(&self.map[window]) {
            *byte = *shown;
        }
        self.answered += 1;
        Ok(())
    }
}

impl ErrorType for Dpr {
    type Error = Broken;
}

impl SpiDevice for Dpr {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Broken> {
        self.answer(operations)
    }
}

struct AsyncDpr(Dpr);

impl ErrorType for AsyncDpr {
    type Error = Broken;
}

impl embedded_hal_async::spi::SpiDevice for AsyncDpr {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Broken> {
        self.0.answer(operations)
    }
}

fn ready<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("nothing here waits"),
    }
}

fn client() -> Client {
    Client::new(Config::new(Layout::for_receivers(3).expect("three receivers"))).expect("a good configuration")
}

#[test]
fn the_blocking_client_reads_a_position_and_then_a_receiver() {
    let mut client = client();
    let mut verdicts = vec![];
    let mut dpr = Dpr::default();
    for n in 0..5 {
        dpr.publish(n);
        let mut port = blocking::Dpr::new(dpr, client);
        if n == 4 {
            port.client().ask(Request { offset: 96, length: 60 }).expect("in the map");
        }
        let report = port.read(10_000 * u64::from(n), Some(10_000 * u64::from(n) - u64::from(n.min(1)))).expect("read");
        verdicts.push(report.verdict);
        client = port.client().clone();
        dpr = port.release();
    }
    assert_eq!(verdicts[..3], [Verdict::Searching; 3]);
    assert_eq!(verdicts[3..], [Verdict::Fresh; 2]);
    let mut port = blocking::Dpr::new(dpr, client);
    let report = port.read(44_000, None).expect("read");
    assert_eq!(report.verdict, Verdict::Window);
    assert_eq!(report.age_us, 5_401 + 4_000, "published 1 us before it was read, 5.3 ms old, and read 4 ms ago");
    let Some(Shown::Intact(gps)) = port.view().object(1) else { panic!("GPS1 is shown") };
    assert_eq!(gps.as_bytes(), seeds::profile::<3>(40).as_bytes().get(Profile::<3>::place(1).unwrap()).unwrap());
    assert!(port.view().object(2).is_none() && port.view().link().is_none(), "and nothing else");
    assert_eq!(port.release().answered, 6);
}

#[test]
fn a_request_is_sent_again_after_the_bus_failed() {
    let mut dpr = Dpr::default();
    dpr.publish(0);
    dpr.broken = true;
    let mut port = blocking::Dpr::new(dpr, client());
    port.client().ask(Request { offset: 96, length: 60 }).expect("in the map");
    let failed = port.read(0, None).expect_err("the bus is broken");
    assert_eq!(failed.bus, Broken);
    assert_eq!((failed.report.verdict, failed.report.age_us), (Verdict::Busy, AGE_UNKNOWN));
    assert!(failed.report.must_fall_back());
    assert!(port.view().bytes().is_empty(), "it brought nothing");
    let late = port.read(30_001, None).expect_err("the bus is broken");
    assert_eq!(late.report.verdict, Verdict::Silent);
    let client = port.client().clone();
    let mut dpr = port.release();
    dpr.broken = false;
    let mut port = blocking::Dpr::new(dpr, client);
    assert_eq!(port.read(34_000, None).map(|report| report.verdict), Ok(Verdict::Searching));
    assert_eq!(port.read(38_000, None).map(|report| report.verdict), Ok(Verdict::Window));
    assert_eq!(port.view().window(), Request { offset: 96, length: 60 });
}

#[test]
fn the_async_client_says_what_the_blocking_one_says() {
    let mut dprs = (Dpr::default(), Dpr::default());
    let mut clients = (client(), client());
    for n in 0..6_u32 {
        dprs.0.publish(n);
        dprs.1.publish(n);
        (dprs.0.broken, dprs.1.broken) = (n == 4, n == 4);
        let mut blocking = blocking::Dpr::new(dprs.0, clients.0);
        let mut asynch = asynch::Dpr::new(AsyncDpr(dprs.1), clients.1);
        let now_us = 10_000 * u64::from(n);
        let said = (blocking.read(now_us, None), ready(asynch.read(now_us, None)));
        assert_eq!(said.0, said.1);
        assert_eq!(said.0.is_err(), n == 4);
        assert_eq!(blocking.view().bytes(), asynch.view().bytes());
        clients = (blocking.client().clone(), asynch.client().clone());
        dprs = (blocking.release(), asynch.release().0);
    }
}

#[test]
fn a_future_that_is_dropped_early_loses_no_request() {
    struct Hung;
    impl ErrorType for Hung {
        type Error = Infallible;
    }
    impl embedded_hal_async::spi::SpiDevice for Hung {
        async fn transaction(&mut self, _: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
            core::future::pending().await
        }
    }
    let mut port = asynch::Dpr::new(Hung, client());
    port.client().ask(Request { offset: 96, length: 60 }).expect("in the map");
    assert!(pin!(port.read(0, None)).poll(&mut Context::from_waker(Waker::noop())).is_pending());
    let mut mosi = [0; 96];
    assert_eq!(port.client().begin(&mut mosi), Ok(96));
    assert_eq!(mosi[..8], ssi::encode(Request { offset: 96, length: 60 }));
}

#[test]
fn an_object_given_during_a_transaction_is_written_in_the_next() {
    let seal = |timestamp| {
        let values = UplinkValues { timestamp, ..UplinkValues::default() };
        Uplink::seal(Writer::<FlightController>::claim(), &values)
    };
    let (first, second) = (seal(1), seal(2));
    let mut client = client();
    let mut mosi = [0; 96];
    client.write(Written::FlightController(&first));
    assert_eq!(client.begin(&mut mosi), Ok(96));
    assert_eq!(&mosi[8..72], first.as_bytes());
    client.write(Written::FlightController(&second));
    client.end(&[0; 96], 0, None);
    assert_eq!(client.begin(&mut mosi), Ok(96));
    assert_eq!(&mosi[8..72], second.as_bytes(), "the first was heard, the second was not sent yet");
    client.end(&[0; 96], 4_000, None);
    assert_eq!(client.begin(&mut mosi), Ok(96));
    assert_eq!(mosi, [0; 96], "both were heard");
}
