//! The signals of a trace, each with its group, its name and its width.

use std::io;

/// A signal, as its index in the list that was passed to [`crate::Trace::create`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Id(pub usize);

/// A signal's value; `None` is high impedance (`z`).
pub type Value = Option<u64>;

/// A signal of a trace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    /// The groups that contain the signal, the outermost first; at least one.
    pub group: Vec<&'static str>,
    /// The signal's name. It has only letters, digits and underscores, which every viewer accepts, and is unique,
    /// because sigrok drops the groups.
    pub name: String,
    /// The signal's width, 1 to 64 bits.
    pub bits: u32,
    /// The value at the start of the trace.
    pub start: Value,
}

/// Every signal, ordered by group. The signals of a group precede the groups within it.
pub(super) fn by_group(signals: &[Signal]) -> Vec<(Id, &Signal)> {
    let mut groups: Vec<&'static str> = vec![];
    for signal in signals {
        if !groups.contains(&signal.group[0]) {
            groups.push(signal.group[0]);
        }
    }
    let mut sorted: Vec<_> = signals.iter().enumerate().map(|(place, signal)| (Id(place), signal)).collect();
    sorted.sort_by_key(|(id, signal)| {
        let group = groups.iter().position(|group| *group == signal.group[0]);
        (group, signal.group.len(), *id)
    });
    sorted
}

/// Returns the digits of `value` in both file formats, most significant first; `z` if nothing drives the signal.
pub(super) fn digits(bits: u32, value: Value) -> impl Iterator<Item = u8> {
    (0..bits).rev().map(move |bit| match value {
        Some(value) => b'0' + u8::from(value >> bit & 1 != 0),
        None => b'z',
    })
}

/// Calls `close` for each group that ends between two successive signals, and `open` for each group that begins.
pub(super) fn regroup<T>(
    to: &mut T,
    from: &[&'static str],
    next: &[&'static str],
    mut open: impl FnMut(&mut T, &'static str) -> io::Result<()>,
    mut close: impl FnMut(&mut T) -> io::Result<()>,
) -> io::Result<()> {
    let common = from.iter().zip(next).take_while(|(of, to)| of == to).count();
    for _ in common..from.len() {
        close(to)?;
    }
    next[common..].iter().try_for_each(|group| open(to, group))
}
