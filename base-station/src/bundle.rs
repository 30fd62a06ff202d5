//! Finds the objects in a message that carries several.
//!
//! The message's length and, over MAVLink, its payload type determine which objects it carries. So a damaged identifier
//! makes only its own object unreadable.

use core::ops::Range;

use profile::criticality::BaseStation;
use profile::{Layout, image};

use crate::Place;

/// The objects that one message carries.
#[derive(Clone, Copy, Debug)]
pub struct Bundle<'a> {
    bytes: &'a [u8],
    first: usize,
    count: usize,
}

impl<'a> Bundle<'a> {
    /// Returns the `count` objects from `first` on, in the order of the map, if `bytes` is as long as all of them. The
    /// hold's object is always alone, because the flight controller's uplink is before it in the map.
    #[must_use]
    pub fn new(first: Place, count: usize, bytes: &'a [u8]) -> Option<Self> {
        let first = first.index();
        let places = Place::ALL.get(first..first.checked_add(count)?)?;
        let length: usize = places.iter().map(|place| place.size()).sum();
        let is_run = count == 1 || !places.contains(&Place::Hold);
        (count > 0 && is_run && length == bytes.len()).then_some(Self { bytes, first, count })
    }

    /// Returns the objects that fill `bytes`: those from `first` on, in the order of the map. `None` if the length of
    /// `bytes` does not fit.
    #[must_use]
    pub fn from_first(first: Place, bytes: &'a [u8]) -> Option<Self> {
        (1..=Place::COUNT).find_map(|count| Self::new(first, count, bytes))
    }

    /// Returns the objects of a profile, which has 124, 184, 244 or 364 bytes.
    #[must_use]
    pub fn profile(layout: Layout, bytes: &'a [u8]) -> Option<Self> {
        Self::new(Place::Reported, layout.objects(), bytes)
    }

    /// Returns the objects of a datagram, a profile or an image. The lengths of all profiles and images differ.
    #[must_use]
    pub fn datagram(bytes: &'a [u8]) -> Option<Self> {
        Layout::ALL.into_iter().find_map(|layout| {
            let image = (bytes.len() == layout.image_len()).then(|| Self::from_first(Place::LinkStatus, bytes));
            image.unwrap_or_else(|| Self::profile(layout, bytes))
        })
    }

    /// Returns the objects of a datagram, a profile, an image or a map, with or without a [hold](profile::hold). The
    /// lengths of all of them differ. The objects of a map come in up to three bundles: those of the image, Port-Status
    /// with the base station's uplink, and the hold's object. The flight controller's uplink is not for a base station.
    #[must_use]
    pub fn all(bytes: &'a [u8]) -> Vec<Self> {
        let layouts = Layout::ALL.into_iter().flat_map(|layout| [layout, layout.with_hold()]);
        let Some(layout) = layouts.into_iter().find(|layout| layout.map_len() == bytes.len()) else {
            return Self::datagram(bytes).into_iter().collect();
        };
        let port = layout.port_status().start..layout.uplink::<BaseStation>().end;
        let parts = [
            (Place::LinkStatus, Some(0..layout.image_len())),
            (Place::PortStatus, Some(port)),
            (Place::Hold, layout.hold()),
        ];
        parts.into_iter().filter_map(|(first, range)| Self::from_first(first, bytes.get(range?)?)).collect()
    }

    /// Returns the bytes of all objects.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Returns the kind and the bytes of each object.
    pub fn objects(&self) -> impl Iterator<Item = (Place, &'a [u8])> + use<'a> {
        let bytes = self.bytes;
        let mut end = 0;
        Place::ALL.into_iter().skip(self.first).take(self.count).map(move |place| {
            let range = Range { start: end, end: end + place.size() };
            end = range.end;
            (place, bytes.get(range).unwrap_or_default())
        })
    }
}

const _: () = assert!(image::LINK_STATUS == 0, "Link-Status is the image's first object");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_length_of_a_datagram_tells_its_objects() {
        for layout in Layout::ALL {
            let bytes: Vec<u8> = (0..layout.image_len()).map(|index| index as u8).collect();
            let image: Vec<_> = Bundle::datagram(&bytes).unwrap().objects().collect();
            assert_eq!(image.len(), 1 + layout.objects());
            assert_eq!(image[0], (Place::LinkStatus, &bytes[..32]));
            let profile: Vec<_> = Bundle::datagram(&bytes[32..]).unwrap().objects().collect();
            assert_eq!(profile, image[1..]);
            for (index, (place, object)) in profile.iter().enumerate() {
                assert_eq!(*object, &bytes[layout.in_image(index).unwrap()]);
                assert_eq!(place.index(), index + 1);
            }
        }
        let known: Vec<_> = (0..2_000).filter(|length| Bundle::datagram(&vec![0; *length]).is_some()).collect();
        assert_eq!(known, [124, 156, 184, 216, 244, 276, 364, 396]);
    }

    #[test]
    fn a_map_has_the_image_the_port_and_the_hold() {
        for layout in Layout::ALL.into_iter().flat_map(|layout| [layout, layout.with_hold()]) {
            let bytes: Vec<u8> = (0..layout.map_len()).map(|index| (index / 3) as u8).collect();
            let all = Bundle::all(&bytes);
            let image: Vec<_> = all[0].objects().collect();
            assert_eq!(image, Bundle::datagram(&bytes[..layout.image_len()]).unwrap().objects().collect::<Vec<_>>());
            let port: Vec<_> = all[1].objects().collect();
            assert_eq!(port[0], (Place::PortStatus, &bytes[layout.port_status()]));
            assert_eq!(port[1..], [(Place::Uplink, &bytes[layout.uplink::<BaseStation>()])]);
            let hold = all[2..].iter().flat_map(Bundle::objects).map(|(place, bytes)| (place, bytes.to_vec()));
            let expected = layout.hold().map(|place| (Place::Hold, bytes[place].to_vec()));
            assert_eq!(hold.collect::<Vec<_>>(), expected.into_iter().collect::<Vec<_>>());
        }
        let known: Vec<_> = (0..2_000).filter(|length| !Bundle::all(&vec![0; *length]).is_empty()).collect();
        let maps = [348, 364, 396, 408, 412, 468, 472, 532, 588, 652];
        assert_eq!(known, [&[124, 156, 184, 216, 244, 276][..], &maps].concat());
    }

    #[test]
    fn a_run_of_objects_must_be_whole() {
        let lengths = |first| {
            (0..500).filter(|length| Bundle::from_first(first, &vec![0; *length]).is_some()).collect::<Vec<_>>()
        };
        assert_eq!(lengths(Place::PortStatus), [64, 128]);
        assert_eq!(lengths(Place::LinkStatus), [32, 96, 156, 216, 276, 336, 396, 460]);
        assert_eq!(lengths(Place::Hold), [64]);
        assert!(Bundle::new(Place::Uplink, 2, &[0; 128]).is_none());
        assert!(Bundle::new(Place::Gps(5), usize::MAX, &[0; 120]).is_none());
        assert!(Bundle::new(Place::Gps(5), 0, &[]).is_none());
    }
}
