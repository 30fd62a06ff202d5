//! State that is kept from one task to the next, with a check word that finds a bit that has flipped in between.
//!
//! # Design
//!
//! A state that a task keeps in RAM has no CRC until it is sent. The [test of the RAM](crate::patrol) finds bits that
//! are stuck, but not a bit that flips once. So [`Checked`] keeps a check word over the memory of such a state. The
//! word is computed anew after each change, and compared before each change and wherever the owner asks.
//!
//! **Check word.** The check word is a sum: each word of memory is added to the sum so far, which is rotated by one
//! bit. Any change of a single word, and so any flipped bit, changes the sum. Changes of several words at once are
//! missed in one case of 2^32 on average. A CRC would detect more of them, but costs about 20 cycles a word instead of
//! 4.
//!
//! **Memory, not fields.** The sum covers the bytes of the state as they lie in memory, with the gaps between fields.
//! So it needs no code for each field, and covers private fields of other crates. A move of the state may change the
//! gaps. So a state has no check word before its first change, because it may still be moved to its place until then.
//!
//! Only the processor may write the state, and only through [`Checked`]. The state must not be moved after its first
//! change.

/// A state with its check word.
#[derive(Debug)]
#[repr(C)]
pub struct Checked<T> {
    state: T,
    /// The check word and its complement. Both are 0 before the first change; a flipped bit cannot produce such a pair.
    check: [u32; 2],
}

impl<T> Checked<T> {
    const WHOLE_WORDS: () = assert!(size_of::<T>().is_multiple_of(4) && align_of::<T>().is_multiple_of(4));
    const UNCHANGED: [u32; 2] = [0; 2];

    /// Returns `state`, which has no check word before its first change. `T` must consist of whole aligned words;
    /// otherwise the build fails.
    #[must_use]
    pub const fn new(state: T) -> Self {
        let () = Self::WHOLE_WORDS;
        Self { state, check: Self::UNCHANGED }
    }

    /// Whether the state has never been changed, and so has no check word yet.
    #[must_use]
    pub fn is_unchanged(&self) -> bool {
        self.check == Self::UNCHANGED
    }

    /// Whether the state is as the last change has left it.
    #[must_use]
    pub fn is_intact(&self) -> bool {
        self.is_unchanged() || self.check == self.sum()
    }

    /// Returns the state, and does not verify it. Whoever acts on it has to ask [`Checked::is_intact`] before the
    /// consequences leave the board.
    #[must_use]
    pub const fn get(&self) -> &T {
        &self.state
    }

    /// Verifies the state, changes it by `change`, and computes its check word anew. Returns what `change` returns. If
    /// the state is not intact, returns `None` and does not call `change`.
    pub fn change<R>(&mut self, change: impl FnOnce(&mut T) -> R) -> Option<R> {
        if !self.is_intact() {
            return None;
        }
        Some(self.change_verified(change))
    }

    /// Changes the state by `change` as [`Checked::change`] does, but without verifying it: a bit that has flipped
    /// since the last [`Checked::is_intact`] is not found any more.
    pub fn change_verified<R>(&mut self, change: impl FnOnce(&mut T) -> R) -> R {
        let result = change(&mut self.state);
        self.check = self.sum();
        result
    }

    /// Replaces the whole state, intact or not.
    pub fn set(&mut self, state: T) {
        self.state = state;
        self.check = self.sum();
    }

    /// Returns the address of the state, as [`Cause::Ram`](crate::last_stop::Cause::Ram) records it.
    #[must_use]
    pub fn address(&self) -> u32 {
        (&raw const self.state).addr() as u32
    }

    fn sum(&self) -> [u32; 2] {
        let sum = words::sum(&self.state);
        [sum, !sum]
    }
}

impl<T> core::borrow::Borrow<T> for Checked<T> {
    fn borrow(&self) -> &T {
        self.get()
    }
}

#[cfg(target_os = "none")]
mod words {
    use crate::memory;

    pub(super) fn sum<T>(state: &T) -> u32 {
        memory::sum(memory::span(state))
    }
}

#[cfg(not(target_os = "none"))]
#[allow(unsafe_code)]
mod words {
    pub(super) fn sum<T>(state: &T) -> u32 {
        let first = (&raw const *state).cast::<u32>();
        // SAFETY: the state has whole aligned words, all of them are read inside of it, and the reads are volatile, so
        // that gaps between fields are read as they lie in memory.
        let word = |index| unsafe { first.add(index).read_volatile() };
        (0..size_of::<T>() / 4).map(word).fold(0_u32, |sum, word| sum.rotate_left(1).wrapping_add(word))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn flip(checked: &mut Checked<[u32; 5]>, bit: usize) {
        checked.state[bit / 32] ^= 1 << (bit % 32);
    }

    proptest! {
        // Shows SAFE-17.
        #[test]
        fn any_bit_of_a_kept_state_that_flips_is_found(state: [u32; 5], other: [u32; 5], bit in 0_usize..160) {
            let mut checked = Checked::new(state);
            prop_assert_eq!(checked.change(|state| core::mem::replace(state, other)), Some(state));
            flip(&mut checked, bit);
            prop_assert!(!checked.is_intact());
            prop_assert_eq!(checked.change(|_| ()), None);
            flip(&mut checked, bit);
            prop_assert_eq!(checked.change(|state| *state), Some(other));
        }

        #[test]
        fn any_bit_of_the_check_word_that_flips_is_found(state: [u32; 5], bit in 0_usize..64) {
            let mut checked = Checked::new([0; 5]);
            checked.set(state);
            checked.check[bit / 32] ^= 1 << (bit % 32);
            prop_assert!(!checked.is_intact());
        }

        #[test]
        fn nothing_is_found_in_states_that_only_their_owner_changes(states: Vec<[u32; 5]>) {
            let mut checked = Checked::new([7; 5]);
            for (index, state) in states.into_iter().enumerate() {
                if index % 2 == 0 {
                    checked.set(state);
                } else {
                    prop_assert!(checked.change(|kept| *kept = state).is_some());
                }
                prop_assert!(checked.is_intact());
                prop_assert_eq!(*checked.get(), state);
            }
        }
    }

    #[test]
    fn a_state_of_zeros_has_a_check_word_once_it_is_changed() {
        let mut checked = Checked::new([0; 5]);
        assert!(checked.is_intact());
        checked.set([0; 5]);
        flip(&mut checked, 33);
        assert!(!checked.is_intact());
    }

    #[test]
    fn the_address_is_where_the_state_lies() {
        let checked = Checked::new([1_u32; 5]);
        assert_eq!(checked.address(), (&raw const checked).addr() as u32);
    }

    #[test]
    fn a_damaged_state_that_is_replaced_is_intact_again() {
        let mut checked = Checked::new([1; 5]);
        checked.set([2; 5]);
        flip(&mut checked, 0);
        checked.set([3; 5]);
        assert_eq!(checked.change(|state| *state), Some([3; 5]));
    }
}
