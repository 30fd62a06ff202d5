//! The layout of a profile whose number of receivers is only known at run time.
//!
//! A firmware's number of receivers is fixed when it is compiled, so it uses [`Profile<N>`](Profile) and
//! [`Image<N>`](Image). A bench, a base station or a tool takes the number from its configuration and uses this module,
//! whose results come from those two types.
//!
//! # Example
//!
//! ```
//! use profile::Layout;
//!
//! let layout = Layout::for_receivers(5).expect("a profile of five receivers");
//! assert_eq!((layout.profile_len(), layout.image_len(), layout.frames()), (364, 396, 2));
//! assert_eq!(layout.in_image(0), Some(32..96));
//! assert_eq!(Layout::for_receivers(4), None);
//! ```
use core::ops::Range;

use crate::air::{self, Objects, Place};
use crate::criticality::WritesUplink;
use crate::image::Image;
use crate::map::Map;
use crate::{Profile, Rejection};

/// Calls code that is generic over the number of receivers `N` with a number that is only known at run time.
macro_rules! with_receivers {
    ($receivers:expr, $n:ident => $answer:expr) => {
        match $receivers {
            Receivers::One => {
                const $n: usize = 1;
                $answer
            }
            Receivers::Two => {
                const $n: usize = 2;
                $answer
            }
            Receivers::Three => {
                const $n: usize = 3;
                $answer
            }
            Receivers::Five => {
                const $n: usize = 5;
                $answer
            }
        }
    };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Receivers {
    One,
    Two,
    Three,
    Five,
}

/// The layout of a profile, its air frames, image and map, for a number of receivers known at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Layout {
    receivers: Receivers,
    has_hold: bool,
}

impl Layout {
    const fn of(receivers: Receivers) -> Self {
        Self { receivers, has_hold: false }
    }

    /// The layouts without a hold for every number of receivers, in ascending order.
    pub const ALL: [Self; 4] =
        [Self::of(Receivers::One), Self::of(Receivers::Two), Self::of(Receivers::Three), Self::of(Receivers::Five)];

    /// The layout for this number of receivers, without a hold; `None` if there is no such profile.
    #[must_use]
    pub const fn for_receivers(receivers: usize) -> Option<Self> {
        match receivers {
            1 => Some(Self::of(Receivers::One)),
            2 => Some(Self::of(Receivers::Two)),
            3 => Some(Self::of(Receivers::Three)),
            5 => Some(Self::of(Receivers::Five)),
            _ => None,
        }
    }

    /// This layout with a [hold](crate::hold), whose object follows the uplinks in the map.
    #[must_use]
    pub const fn with_hold(self) -> Self {
        Self { has_hold: true, ..self }
    }

    /// The number of receivers: 1, 2, 3 or 5.
    #[must_use]
    pub const fn receivers(self) -> usize {
        with_receivers!(self.receivers, N => N)
    }

    /// The number of objects of the profile, Reported-Position included: 2, 3, 4 or 6.
    #[must_use]
    pub const fn objects(self) -> usize {
        with_receivers!(self.receivers, N => Profile::<N>::OBJECTS)
    }

    /// The size of the profile in bytes: 124, 184, 244 or 364.
    #[must_use]
    pub const fn profile_len(self) -> usize {
        with_receivers!(self.receivers, N => Profile::<N>::SIZE)
    }

    /// The size of the image in bytes: 156, 216, 276 or 396.
    #[must_use]
    pub const fn image_len(self) -> usize {
        with_receivers!(self.receivers, N => Image::<N>::LEN)
    }

    /// The size of the map in bytes: 348, 408, 468 or 588; with a hold 412, 472, 532 or 652.
    #[must_use]
    pub const fn map_len(self) -> usize {
        with_receivers!(self.receivers, N => if self.has_hold { Map::<N>::LEN_WITH_HOLD } else { Map::<N>::LEN })
    }

    /// The range of the hold's object in the map; `None` without a hold.
    #[must_use]
    pub const fn hold(self) -> Option<Range<usize>> {
        if self.has_hold { Some(with_receivers!(self.receivers, N => Map::<N>::hold())) } else { None }
    }

    /// The range of Port-Status in the map.
    #[must_use]
    pub const fn port_status(self) -> Range<usize> {
        with_receivers!(self.receivers, N => Map::<N>::port_status())
    }

    /// The range of the uplink of role `W` in the map.
    #[must_use]
    pub const fn uplink<W: WritesUplink>(self) -> Range<usize> {
        with_receivers!(self.receivers, N => Map::<N>::uplink::<W>())
    }

    /// The range of object number `index` in the profile; `None` if there is no such object.
    #[must_use]
    pub const fn in_profile(self, index: usize) -> Option<Range<usize>> {
        with_receivers!(self.receivers, N => Profile::<N>::place(index))
    }

    /// The range of the profile's object number `index` in the image; `None` if there is no such object.
    #[must_use]
    pub const fn in_image(self, index: usize) -> Option<Range<usize>> {
        with_receivers!(self.receivers, N => Image::<N>::place(index))
    }

    /// The number of air frames in a cycle: 1 or 2.
    #[must_use]
    pub const fn frames(self) -> usize {
        air::frames(self.receivers())
    }

    /// The objects of frame number `frame` of a cycle, from 0; `None` if there is no such frame.
    #[must_use]
    pub const fn frame(self, frame: usize) -> Option<Place> {
        with_receivers!(self.receivers, N => Place::of_frame::<N>(frame))
    }

    /// Returns the parts of an air frame's payload that should be objects, each with its object's number in the
    /// profile.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if no frame of a profile with this number of receivers is as long as the payload.
    pub fn objects_of(self, payload: &[u8]) -> Result<Objects<'_>, Rejection> {
        with_receivers!(self.receivers, N => air::objects::<N>(payload))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agrees<const N: usize>() {
        let layout = Layout::for_receivers(N).unwrap();
        assert_eq!(layout.receivers(), N);
        assert_eq!(layout.objects(), Profile::<N>::OBJECTS);
        assert_eq!(layout.profile_len(), size_of::<Profile<N>>());
        assert_eq!(layout.image_len(), size_of::<Image<N>>());
        for index in 0..=N + 1 {
            assert_eq!(layout.in_profile(index), Profile::<N>::place(index));
            assert_eq!(layout.in_image(index), Image::<N>::place(index));
        }
        assert_eq!((layout.map_len(), layout.hold()), (Map::<N>::LEN, None));
        let with_hold = layout.with_hold();
        assert_eq!((with_hold.map_len(), with_hold.hold()), (Map::<N>::LEN_WITH_HOLD, Some(Map::<N>::hold())));
        assert_eq!((with_hold.image_len(), with_hold.port_status()), (layout.image_len(), layout.port_status()));
        assert_eq!(Map::<N>::hold(), layout.map_len()..layout.map_len() + 64);
        for frame in 0..3 {
            assert_eq!(layout.frame(frame), Place::of_frame::<N>(frame));
        }
    }

    #[test]
    fn every_layout_is_that_of_the_const_generics() {
        agrees::<1>();
        agrees::<2>();
        agrees::<3>();
        agrees::<5>();
        assert_eq!(Layout::ALL.map(Layout::receivers), [1, 2, 3, 5]);
        for none in [0, 4, 6, usize::MAX] {
            assert_eq!(Layout::for_receivers(none), None);
        }
    }

    #[test]
    fn the_objects_fill_the_profile_and_its_frames_without_a_gap() {
        for layout in Layout::ALL {
            let mut end = 0;
            for index in 0..layout.objects() {
                let place = layout.in_profile(index).unwrap();
                assert_eq!(place.start, end);
                let image = layout.in_image(index).unwrap();
                assert_eq!(image.start - place.start, layout.image_len() - layout.profile_len());
                end = place.end;
            }
            assert_eq!(end, layout.profile_len());
            assert_eq!(layout.in_profile(layout.objects()), None);
            let frames = (0..layout.frames()).map(|frame| layout.frame(frame).unwrap().length());
            assert_eq!(frames.sum::<usize>(), layout.profile_len());
            assert_eq!(layout.frame(layout.frames()), None);
        }
    }

    #[test]
    fn a_payload_is_split_at_the_objects_that_its_length_tells() {
        let layout = Layout::for_receivers(5).unwrap();
        let split =
            |bytes: &[u8]| layout.objects_of(bytes).map(|objects| objects.map(|(index, _)| index).sum::<usize>());
        assert_eq!(split(&[0; 184]), Ok(1 + 2));
        assert_eq!(split(&[0; 180]), Ok(3 + 4 + 5));
        assert_eq!(split(&[0; 244]), Err(Rejection::Length));
    }
}
