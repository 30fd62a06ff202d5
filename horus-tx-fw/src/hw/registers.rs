//! The address of a peripheral's registers, which the board's table gives
//!
//! `unsafe` is used here to share an address between tasks.
#![allow(unsafe_code)]

pub(super) struct Registers<T>(*const T);

// SAFETY: the value is only an address. Whoever makes a reference of it has to prove that it may ([`Registers::get`]).
unsafe impl<T> Send for Registers<T> {}
// SAFETY: the value is only an address. Whoever makes a reference of it has to prove that it may ([`Registers::get`]).
unsafe impl<T> Sync for Registers<T> {}

impl<T> Clone for Registers<T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Registers<T> {}

impl<T> Registers<T> {
    pub(super) const fn at(address: *const T) -> Self {
        Self(address)
    }

    ///
    /// # Safety
    ///
    /// The address is that of a block of registers that are laid out like `T`, and nothing that this caller does
    /// through it disturbs another user of the peripheral.
    pub(super) const unsafe fn get(self) -> &'static T {
        // SAFETY: a register block is always there, every access is volatile, and the caller guarantees the rest.
        unsafe { &*self.0 }
    }
}
