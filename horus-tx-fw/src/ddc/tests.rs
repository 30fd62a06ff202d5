//! Tests one receiver's I2C port event by event, with every fault of the bus that HORUS has to survive.

extern crate std;
use super::*;
use crate::source::{Rate, MESSAGE};
use proptest::prelude::*;
use std::{collections::VecDeque, vec, vec::Vec};

const FREE: Bus = Bus { scl: true, sda: true, busy: false };

/// A fault of the bus that a test injects when the I2C port gives a certain order of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// The receiver holds the clock low, so no further event comes. Until then a read has brought this number of bytes.
    Held(usize),
    Refused,
    ArbitrationLost,
    /// This number of spurious events comes: events that no order has caused.
    Spurious(u8),
    BusError,
    StreamFails,
}

/// A model of the I2C peripheral and of a receiver. It carries out the port's orders, and reports to the port the
/// events that follow.
struct Rig {
    ddc: Ddc,
    waiting: VecDeque<u8>,
    register: u8,
    written: Vec<u8>,
    messages: Vec<Vec<u8>>,
    delivered: Vec<u8>,
    levels: Vec<(bool, bool)>,
    is_there: bool,
    /// The bits that survive in the number of waiting bytes, as a mask. A pulse on SDA clears the other bits of that
    /// number.
    count_mask: u16,
    bus: Bus,
}

impl Rig {
    fn new() -> Self {
        let mut rig = Self::with_backlog();
        rig.cycle(None);
        rig.cycle(None);
        rig
    }

    fn with_backlog() -> Self {
        Self {
            ddc: Ddc::new(),
            waiting: VecDeque::new(),
            register: 0xFF,
            written: Vec::new(),
            messages: Vec::new(),
            delivered: Vec::new(),
            levels: Vec::new(),
            is_there: true,
            count_mask: u16::MAX,
            bus: FREE,
        }
    }

    fn end_of_write(&mut self) {
        match self.written.len() {
            0 => {}
            1 => self.register = self.written[0],
            _ => self.messages.push(self.written.clone()),
        }
        self.written.clear();
    }

    fn read(&mut self, len: usize) -> Vec<u8> {
        let count = (self.waiting.len().min(0xFFFE) as u16 & self.count_mask).to_be_bytes();
        (0..len)
            .map(|_| {
                let byte = match self.register {
                    0xFD => count[0],
                    0xFE => count[1],
                    _ => self.waiting.pop_front().unwrap_or(0xFF),
                };
                self.register = self.register.saturating_add(1);
                byte
            })
            .collect()
    }

    fn deliver(&mut self, bytes: &[u8]) -> Order {
        let first = [bytes[0], bytes[1], bytes.get(2).copied().unwrap_or(0)];
        let Received { stream, then } = self.ddc.received(first);
        self.delivered.extend_from_slice(&bytes[stream]);
        then
    }

    /// Runs one cycle, in which `fault` happens at the order with the given number. Returns how many orders the cycle
    /// had.
    fn cycle(&mut self, fault: Option<(usize, Fault)>) -> usize {
        let mut order = self.ddc.poll(self.bus);
        let mut orders = 0;
        let mut reads = false;
        let mut starting = false;
        loop {
            assert!(orders < 200, "a cycle has an end");
            let hit = fault.and_then(|(at, fault)| (at == orders).then_some(fault));
            orders += 1;
            let mut events = Events::default();
            let quiet = matches!(order, Order::Nothing | Order::Stop | Order::Mute | Order::Rejoin);
            match hit {
                Some(Fault::Held(come)) if !quiet => {
                    if let (Order::Receive(len), Some(under_way)) = (order, self.ddc.stream_under_way()) {
                        assert_eq!(len, under_way);
                        let come = self.read(come % len);
                        self.delivered.extend_from_slice(&come);
                    }
                    self.written.clear();
                    return orders;
                }
                Some(Fault::Spurious(times)) if !quiet => {
                    for _ in 0..times {
                        let answer = self.ddc.event(Events::default());
                        assert!(matches!(answer, Order::Nothing | Order::Mute));
                        if answer == Order::Mute {
                            return orders;
                        }
                    }
                }
                Some(Fault::BusError) => events.bus_error = true,
                _ => {}
            }
            order = match order {
                Order::Nothing | Order::Mute | Order::Rejoin => return orders,
                Order::Stop => {
                    self.end_of_write();
                    return orders;
                }
                Order::Start => {
                    self.end_of_write();
                    starting = true;
                    events.started = true;
                    self.ddc.event(events)
                }
                Order::Put(_) | Order::PutAddressed(_)
                    if matches!(hit, Some(Fault::Refused | Fault::ArbitrationLost)) =>
                {
                    events.refused = hit == Some(Fault::Refused);
                    events.arbitration_lost = hit == Some(Fault::ArbitrationLost);
                    self.written.clear();
                    self.ddc.event(events)
                }
                Order::Put(address) if starting => {
                    starting = false;
                    assert_eq!(address >> 1, ADDRESS);
                    reads = address & 1 == 1;
                    events.addressed = self.is_there;
                    events.refused = !self.is_there;
                    self.ddc.event(events)
                }
                Order::Put(byte) | Order::PutAddressed(byte) => {
                    assert!(!reads, "nothing is written while a read is under way");
                    self.written.push(byte);
                    events.byte_sent = true;
                    self.ddc.event(events)
                }
                Order::Receive(_) if hit == Some(Fault::StreamFails) => self.ddc.stream_failed(),
                Order::Receive(len) => {
                    assert!(reads && (2..=MOST).contains(&len), "a read of {len} bytes");
                    let bytes = self.read(len);
                    self.deliver(&bytes)
                }
                Order::Release => {
                    self.levels = vec![(true, true)];
                    self.ddc.step()
                }
                Order::Drive { scl, sda } => {
                    self.levels.push((scl, sda));
                    self.ddc.step()
                }
            };
        }
    }
}

#[test]
fn a_message_is_written_in_a_cycle_of_its_own_and_once() {
    let mut rig = Rig::new();
    rig.waiting.extend([1, 2, 3]);
    let message = Message::new(&[0xB5; MESSAGE], Rate::Usual);
    assert_eq!(rig.ddc.transmit(&message), Ok(()));
    assert_eq!(rig.ddc.transmit(&message), Err(Busy));
    rig.cycle(None);
    assert_eq!((rig.messages.len(), rig.delivered.len()), (1, 0));
    rig.cycle(None);
    assert_eq!((&rig.messages[..], &rig.delivered[..]), (&[vec![0xB5; MESSAGE]][..], &[1, 2, 3][..]));
    assert_eq!(*rig.ddc.counts(), Counts::default());
}

#[test]
fn a_single_byte_is_read_together_with_its_count() {
    let mut rig = Rig::new();
    rig.waiting.push_back(0xFF);
    rig.cycle(None);
    assert_eq!(rig.delivered, [0xFF]);
    rig.cycle(None);
    assert_eq!(rig.delivered, [0xFF], "what is read of an empty stream is not the receiver's");
}

#[test]
fn a_count_of_all_ones_is_none() {
    let mut ddc = Ddc::new();
    ddc.poll(FREE);
    ddc.state = State::Receiving(Phase::Waiting(2));
    assert_eq!(ddc.received([0xFF, 0xFF, 0]), Received { stream: 0..0, then: Order::Stop });
}

#[test]
fn an_absent_receiver_costs_one_start_a_cycle_and_no_recovery() {
    let mut rig = Rig::new();
    rig.is_there = false;
    for _ in 0..100 {
        assert!(rig.cycle(None) <= 3);
    }
    assert_eq!(*rig.ddc.counts(), Counts { timed_out: 0, recoveries: 0, refused: 100 });
}

#[test]
fn a_recovery_is_nine_clocks_and_a_stop() {
    let mut rig = Rig::new();
    rig.bus.sda = false;
    rig.cycle(None);
    let rising = rig.levels.windows(2).filter(|pair| !pair[0].0 && pair[1].0).count();
    assert_eq!(rising, 10, "nine clocks, and that of the STOP");
    let stops: Vec<_> = rig.levels.windows(2).filter(|pair| pair[0] == (true, false) && pair[1].1).collect();
    assert_eq!(stops, [[(true, false), (true, true)]], "SDA rises once, while SCL is high");
    let falls = rig.levels.windows(2).filter(|pair| pair[0] == (true, true) && pair[1] == (true, false)).count();
    assert_eq!(falls, 0, "and no START is among it");
    assert_eq!(rig.levels.len(), 23);
}

#[test]
fn a_bus_that_stays_stuck_is_recovered_ten_times_a_second() {
    let mut rig = Rig::new();
    rig.waiting.extend([1, 2, 3]);
    rig.bus.scl = false;
    for _ in 0..100 {
        rig.cycle(None);
    }
    assert_eq!(rig.ddc.counts().recoveries, 10);
    rig.bus = FREE;
    rig.cycle(None);
    assert_eq!(rig.delivered, [], "they have waited for a second");
    rig.cycle(None);
    rig.waiting.extend([4, 5]);
    rig.cycle(None);
    assert_eq!(rig.delivered, [4, 5]);
}

// Shows REC-13.
#[test]
fn bytes_that_waited_before_the_first_read_are_dropped() {
    let mut rig = Rig::with_backlog();
    rig.waiting.extend(std::iter::repeat_n(1, MOST + 44));
    rig.cycle(None);
    rig.waiting.extend([2, 2]);
    rig.cycle(None);
    rig.cycle(None);
    assert!(rig.waiting.is_empty() && rig.delivered.is_empty());
    rig.waiting.push_back(3);
    rig.cycle(None);
    assert_eq!(rig.delivered, [3]);
    let mut rig = Rig::with_backlog();
    for _ in 0..2 {
        rig.waiting.push_back(1);
        rig.cycle(None);
    }
    rig.waiting.extend([2, 2]);
    rig.cycle(None);
    assert_eq!(rig.delivered, [2, 2], "a single byte is an empty receiver's last, too");
}

#[test]
fn one_count_that_reads_too_low_lets_nothing_old_through() {
    for count_mask in [0x0000, 0x0001, 0x000F] {
        let mut rig = Rig::with_backlog();
        rig.waiting.extend([1; 200]);
        rig.count_mask = count_mask;
        rig.cycle(None);
        rig.count_mask = u16::MAX;
        rig.cycle(None);
        assert!(rig.waiting.is_empty() && rig.delivered.is_empty(), "{count_mask:#06X}");
        rig.waiting.extend([2, 2]);
        rig.cycle(None);
        assert_eq!(rig.delivered, [2, 2]);
    }
}

#[test]
fn bytes_are_dropped_after_two_failed_cycles_but_not_after_one() {
    for (failures, kept) in [(1, true), (2, false)] {
        let mut rig = Rig::new();
        rig.waiting.extend([1, 2, 3]);
        for _ in 0..failures {
            rig.is_there = false;
            rig.cycle(None);
            rig.is_there = true;
        }
        rig.cycle(None);
        assert_eq!(!rig.delivered.is_empty(), kept, "{failures}");
    }
}

#[test]
fn a_backlog_is_dropped_until_the_receiver_was_read_empty() {
    let mut rig = Rig::new();
    rig.waiting.extend(std::iter::repeat_n(1, 3 * MOST));
    rig.cycle(None);
    assert_eq!(rig.delivered.len(), MOST, "one cycle's more is read in the next");
    rig.cycle(None);
    rig.cycle(None);
    assert!(rig.waiting.is_empty());
    rig.cycle(None);
    assert_eq!(rig.delivered.len(), MOST);
    rig.waiting.push_back(2);
    rig.cycle(None);
    assert_eq!(rig.delivered.len(), MOST + 1);
}

#[test]
fn old_bytes_of_an_abandoned_transaction_are_dropped() {
    for (ddc, kept) in [(Rig::new().ddc, Some(7)), (Ddc::new(), None)] {
        let mut ddc = ddc;
        ddc.state = State::Receiving(Phase::Stream(7));
        assert_eq!(ddc.stream_under_way(), kept);
    }
}

#[test]
fn a_data_line_that_stays_stuck_is_recovered_in_the_next_cycle() {
    let mut rig = Rig::new();
    rig.bus.scl = false;
    rig.cycle(None);
    rig.cycle(None);
    assert_eq!(rig.ddc.counts().recoveries, 1);
    rig.bus = Bus { sda: false, ..FREE };
    rig.cycle(None);
    assert_eq!(rig.ddc.counts().recoveries, 2);
}

#[test]
fn events_without_progress_are_switched_off() {
    let mut ddc = Ddc::new();
    ddc.poll(FREE);
    let calls = (0..1_000).take_while(|_| ddc.event(Events::default()) != Order::Mute).count();
    assert_eq!(calls, usize::from(MOST_SPURIOUS) - 1);
    assert_eq!(ddc.poll(FREE), Order::Release);
}

#[test]
fn bus_errors_are_bounded_between_two_ticks_whatever_progress_the_bus_makes() {
    let mut ddc = Ddc::new();
    ddc.transmit(&Message::new(&[0; MESSAGE], Rate::Usual)).unwrap();
    ddc.poll(FREE);
    let error = Events { bus_error: true, ..Events::default() };
    let start = [Events { started: true, ..Events::default() }, Events { addressed: true, ..Events::default() }];
    let progress = start.into_iter().chain(std::iter::repeat(Events { byte_sent: true, ..Events::default() }));
    // Bus errors come between the events that show progress, too few in a row to count as a lack of progress.
    let calls = progress.flat_map(|event| [error; MOST_SPURIOUS as usize - 2].into_iter().chain([event]));
    let mut errors = 0;
    for events in calls {
        errors += usize::from(events.bus_error);
        match ddc.event(events) {
            Order::Mute => break,
            order => assert_ne!(order, Order::Stop, "{errors} errors did not end the transaction"),
        }
    }
    assert_eq!(errors, usize::from(MOST_BUS_ERRORS));
    assert_eq!(ddc.poll(FREE), Order::Release, "what has not ended by the tick has failed");
    assert_eq!(ddc.event(error), Order::Nothing, "each tick counts anew");
}

#[test]
fn a_missing_timer_does_not_end_the_recoveries() {
    let mut ddc = Ddc::new();
    assert_eq!(ddc.poll(Bus { sda: false, ..FREE }), Order::Release);
    assert_eq!(ddc.poll(FREE), Order::Release);
    assert_eq!(*ddc.counts(), Counts { timed_out: 1, recoveries: 2, refused: 0 });
}

/// Requests the number of waiting bytes, and goes on until the DMA stream starts. Returns the stream's number of bytes.
fn asked(ddc: &mut Ddc) -> usize {
    let on = |event: fn(&mut Events)| {
        let mut events = Events::default();
        event(&mut events);
        events
    };
    let order = match ddc.state {
        State::Idle => ddc.poll(FREE),
        _ => Order::Start,
    };
    assert_eq!(order, Order::Start);
    assert_eq!(ddc.event(on(|it| it.started = true)), Order::Put(WRITE));
    assert_eq!(ddc.event(on(|it| it.addressed = true)), Order::PutAddressed(WAITING));
    assert_eq!(ddc.event(on(|it| it.byte_sent = true)), Order::Start);
    assert_eq!(ddc.event(on(|it| it.started = true)), Order::Put(READ));
    match ddc.event(on(|it| it.addressed = true)) {
        Order::Receive(len) => len,
        order => panic!("{order:?}"),
    }
}

#[test]
fn a_single_byte_that_has_gone_when_it_is_read_is_none() {
    for (waiting, stream) in [(0, 2..2), (1, 2..3)] {
        let mut ddc = Rig::new().ddc;
        assert_eq!(asked(&mut ddc), 2);
        assert_eq!(ddc.received([0, 1, 0]), Received { stream: 0..0, then: Order::Start });
        assert_eq!(asked(&mut ddc), 3, "the count again, and the byte");
        assert_eq!(ddc.received([0, waiting, 0xFF]), Received { stream, then: Order::Stop });
    }
}

#[test]
fn only_a_failed_stream_that_is_under_way_causes_a_recovery() {
    let mut ddc = Rig::new().ddc;
    assert_eq!(ddc.stream_failed(), Order::Nothing);
    assert_eq!(asked(&mut ddc), 2);
    assert_eq!(ddc.stream_failed(), Order::Release);
    assert_eq!(ddc.stream_failed(), Order::Nothing);
    assert_eq!(ddc.counts().recoveries, 1);
}

#[test]
fn an_unexpected_refusal_is_not_counted_and_ends_no_recovery() {
    let refused = Events { refused: true, ..Events::default() };
    let mut ddc = Rig::new().ddc;
    assert_eq!(ddc.event(refused), Order::Mute, "idle");
    assert_eq!(ddc.poll(Bus { sda: false, ..FREE }), Order::Release);
    assert_eq!(ddc.event(refused), Order::Mute, "recovering");
    assert_eq!(ddc.step(), Order::Drive { scl: false, sda: true });
    assert_eq!(ddc.counts().refused, 0);
}

fn any_fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        (0..MOST).prop_map(Fault::Held),
        Just(Fault::Refused),
        Just(Fault::ArbitrationLost),
        (1..40_u8).prop_map(Fault::Spurious),
        Just(Fault::BusError),
        Just(Fault::StreamFails),
    ]
}

fn is_left_of(part: &[u8], whole: &[u8]) -> bool {
    let mut whole = whole.iter();
    part.iter().all(|byte| whole.any(|other| other == byte))
}

proptest! {
    #[test]
    fn every_byte_is_delivered_once_and_in_order(
        bursts in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..=MOST), 1..20),
    ) {
        let mut rig = Rig::new();
        let mut sent = Vec::new();
        for burst in bursts {
            rig.waiting.extend(&burst);
            sent.extend(burst);
            rig.cycle(None);
        }
        while !rig.waiting.is_empty() {
            rig.cycle(None);
        }
        prop_assert_eq!(rig.delivered, sent);
        prop_assert_eq!(*rig.ddc.counts(), Counts::default());
    }

    #[test]
    fn whatever_goes_wrong_ends_with_its_cycle_and_invents_nothing(
        cycles in proptest::collection::vec(
            (proptest::collection::vec(any::<u8>(), 0..200), any::<bool>(), 0..60_usize, any_fault()), 1..60),
    ) {
        let mut rig = Rig::new();
        let mut sent = Vec::new();
        for (burst, has_message, at, fault) in cycles {
            rig.waiting.extend(&burst);
            sent.extend(burst);
            if has_message {
                let _ = rig.ddc.transmit(&Message::new(&[1; MESSAGE], Rate::Usual));
            }
            // The longest cycle sends a message and drives 23 levels of a recovery.
            prop_assert!(rig.cycle(Some((at, fault))) <= MESSAGE + 24 + 4);
        }
        // After two reads in a row that leave no byte in the receiver, its bytes no longer count as old. So all later
        // bytes arrive.
        rig.cycle(None);
        rig.cycle(None);
        while !rig.waiting.is_empty() {
            rig.cycle(None);
        }
        rig.cycle(None);
        prop_assert!(is_left_of(&rig.delivered, &sent));
        let before = rig.delivered.len();
        rig.waiting.extend(0..200_u8);
        rig.cycle(None);
        prop_assert_eq!(&rig.delivered[before..], &(0..200_u8).collect::<Vec<_>>()[..]);
    }
}
