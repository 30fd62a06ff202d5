use crate::common;

use bench_judge::read::{Frame, Reading, State, Values, Window, is_vacant};
use common::*;
use profile::ssi::{Request, encode};
use profile::{Layout, LinkValues, Rejection};

#[test]
fn a_frame_has_its_number_its_objects_and_their_timestamp() {
    for layout in Layout::ALL {
        let profile = profile(layout.receivers(), 70);
        for number in 0..layout.frames() {
            let place = layout.frame(number).unwrap();
            let payload = &profile[place.offset()..place.offset() + place.length()];
            let read = Frame::of(layout, &frame(payload), true);
            assert_eq!((read.payload.as_slice(), read.number, read.timestamp()), (payload, Some(number), Some(70)));
            let indices: Vec<_> = read.objects.iter().map(|object| object.index).collect();
            assert_eq!(indices, (place.first()..place.first() + place.count()).collect::<Vec<_>>());
            let bytes: Vec<_> = read.objects.iter().flat_map(|object| object.bytes.clone()).collect();
            assert_eq!(bytes, payload);
            for object in &read.objects {
                let State::Valid { timestamp: 70, values } = &object.state else { panic!("{object:?}") };
                assert_eq!(matches!(values, Values::Reported(_)), object.index == 0);
            }
        }
    }
}

#[test]
fn a_frame_of_no_frames_length_has_no_objects() {
    let layout = Layout::for_receivers(3).unwrap();
    for bytes in [vec![], vec![1], vec![1, 2], vec![1, 2, 3], vec![4, 9, 2, 3], vec![0; 246], vec![0; 248]] {
        let read = Frame::of(layout, &bytes, true);
        assert_eq!((read.number, read.timestamp()), (None, None));
        assert_eq!(read.objects, []);
        assert_eq!(read.payload.len(), bytes.len().saturating_sub(3));
    }
    assert_eq!(Frame::of(layout, &[4, 9, 2, 3], true).payload, [9]);
}

#[test]
fn the_timestamp_of_a_frame_is_that_of_its_first_valid_object() {
    let layout = Layout::for_receivers(3).unwrap();
    let mut payload = profile(3, 70);
    payload[64..].copy_from_slice(&profile(3, 80)[64..]);
    assert_eq!(Frame::of(layout, &frame(&payload), true).timestamp(), Some(70));
    payload[0] ^= 1;
    let read = Frame::of(layout, &frame(&payload), true);
    assert_eq!(read.timestamp(), Some(80));
    assert_eq!(read.objects[0].state, State::Unsound(Rejection::Crc));
    assert_eq!(read.objects[0].timestamp(), None);
    payload[64..124].fill(0xFF);
    let read = Frame::of(layout, &frame(&payload), true);
    assert_eq!((read.objects[1].state.clone(), read.timestamp()), (State::Vacant, Some(80)));
}

#[test]
fn a_place_is_vacant_if_it_is_0x00_or_0xff_throughout() {
    assert!(is_vacant(&[0; 60]) && is_vacant(&[0xFF; 60]));
    assert!(!is_vacant(&[0, 0xFF]) && !is_vacant(&[0, 0, 1]) && !is_vacant(&[0xFF, 0xFF, 0xFE]));
}

#[test]
fn a_transaction_brings_what_lies_in_its_window_as_a_whole() {
    let plan = Plan::new(3, 1);
    let layout = plan.layout;
    let image = plan.image(70_000_000, Some(50), LinkValues { frames_received: 5, ..LinkValues::default() });
    let indices = |reading: &Reading| reading.objects.iter().map(|object| object.index).collect::<Vec<_>>();
    let whole = Reading::of(layout, 1, 2, 0, &image);
    assert_eq!((whole.selected, whole.deselected, whole.offset, whole.silent), (1, 2, 0, false));
    assert_eq!(whole.link.unwrap().unwrap().frames_received, 5);
    assert_eq!((indices(&whole), whole.timestamp(), &whole.miso), (vec![0, 1, 2, 3], Some(50), &image));
    for (window, link, objects) in [
        (0..96, true, vec![0]),
        (0..95, true, vec![]),
        (0..31, false, vec![]),
        (1..276, false, vec![0, 1, 2, 3]),
        (33..275, false, vec![1, 2]),
        (96..276, false, vec![1, 2, 3]),
    ] {
        let reading = Reading::of(layout, 1, 2, window.start, &image[window.clone()]);
        assert_eq!((reading.link.is_some(), indices(&reading)), (link, objects), "{window:?}");
        assert_eq!(reading.timestamp(), indices(&reading).first().map(|_| 50));
    }
    let mut damaged = image.clone();
    damaged[3] ^= 1;
    assert_eq!(Reading::of(layout, 1, 2, 0, &damaged).link, Some(Err(Rejection::Crc)));
    let nothing = Reading::of(layout, 1, 2, 0, &[0xFF; 276]);
    assert_eq!((nothing.silent, nothing.link, nothing.objects, nothing.miso.len()), (true, None, vec![], 276));
}

#[test]
fn a_request_chooses_the_window_of_the_next_transaction_that_is_served() {
    let layout = Layout::for_receivers(3).unwrap();
    let request = |offset, length| encode(Request { offset, length });
    let mut window = Window::default();
    assert_eq!(window.offset(), 0);
    window.transaction(layout, &[&request(96, 180)[..], &[0; 64]].concat(), false);
    assert_eq!(window.offset(), 96);
    // The DPR was busy, so it did not receive the request. The window requested before still applies.
    window.transaction(layout, &request(32, 64), true);
    assert_eq!(window.offset(), 96);
    for nothing in [&[0; 8][..], &[0xFF; 8], &[], &request(96, 180)[..7], &request(96, 400), &[7; 8]] {
        window.transaction(layout, &request(96, 180), false);
        window.transaction(layout, nothing, false);
        assert_eq!(window.offset(), 0, "{nothing:?}");
    }
}
