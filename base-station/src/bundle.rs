//! Finds the objects in a message that carries several.
//!
//! The message's length and, over MAVLink, its payload type determine which objects are in it. So a damaged identifier
//! makes only its own object unreadable.

use core::ops::Range;

use profile::{Layout, image};

use crate::Place;

/// The objects of one message.
#[derive(Clone, Copy, Debug)]
pub struct Bundle<'a> {
    bytes: &'a [u8],
    first: usize,
    count: usize,
}

impl<'a> Bundle<'a> {
    /// Returns the `count` objects from `first` on, in the order of the map, if `bytes` have their total length.
    #[must_use]
    pub fn new(first: Place, count: usize, bytes: &'a [u8]) -> Option<Self> {
        let first = first.index();
        let places = Place::ALL.get(first..first.checked_add(count)?)?;
        let length: usize = places.iter().map(|place| place.size()).sum();
        (count > 0 && length == bytes.len()).then_some(Self { bytes, first, count })
    }

    /// Returns the objects from `first` on, in the order of the map, that fill `bytes`; `None` if the length of `bytes`
    /// does not fit.
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
    fn a_run_of_objects_must_be_whole() {
        let lengths = |first| {
            (0..500).filter(|length| Bundle::from_first(first, &vec![0; *length]).is_some()).collect::<Vec<_>>()
        };
        assert_eq!(lengths(Place::PortStatus), [64, 128]);
        assert_eq!(lengths(Place::LinkStatus), [32, 96, 156, 216, 276, 336, 396, 460]);
        assert!(Bundle::new(Place::Uplink, 2, &[0; 128]).is_none());
        assert!(Bundle::new(Place::Gps(5), usize::MAX, &[0; 120]).is_none());
        assert!(Bundle::new(Place::Gps(5), 0, &[]).is_none());
    }
}
