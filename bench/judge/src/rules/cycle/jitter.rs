//! Series of which only the least and the greatest value count, and the jitter of one start of HORUS.

use profile::Layout;

use crate::{Context, Findings, Span, Violation, bounds};

/// A value and when it occurred, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    value: u64,
    at: u64,
}

/// A series of which the extremes are kept.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Series {
    extremes: Option<(Sample, Sample)>,
    sum: u128,
    count: u64,
}

impl Series {
    pub(super) fn push(&mut self, value: u64, at: u64) {
        let sample = Sample { value, at };
        let (min, max) = self.extremes.unwrap_or((sample, sample));
        self.extremes =
            Some((if value < min.value { sample } else { min }, if value > max.value { sample } else { max }));
        self.sum += u128::from(value);
        self.count += 1;
    }

    pub(super) fn span(&self) -> Option<Span> {
        self.extremes.map(|(min, max)| Span { min: min.value, max: max.value })
    }

    /// How far the series is out of `bound`, peak to peak, if it is: its span, and when the extreme occurred that lies
    /// farther from the mean.
    fn beyond(&self, bound: u64) -> Option<Outlier> {
        let (min, max) = self.extremes?;
        let span = self.span().filter(|span| span.width() > bound)?;
        // mean - min > max - mean, in whole numbers.
        let low = 2 * self.sum > u128::from(self.count) * u128::from(min.value + max.value);
        Some(Outlier { span, at: if low { min.at } else { max.at }, bound })
    }
}

/// A jitter that is too great.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Outlier {
    span: Span,
    at: u64,
    bound: u64,
}

/// What may vary by little alone, from one start of HORUS to the next. Frames are told apart by their number in the
/// cycle, of which there are at most two.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Jitter {
    /// Between two ticks.
    pub(super) ticks: Series,
    /// From tick to command.
    pub(super) command: [Series; 2],
    /// From tick to first preamble bit.
    pub(super) air: [Series; 2],
}

/// The greatest jitter of each kind of all starts of HORUS.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Worst {
    ticks: Option<Outlier>,
    command: Option<Outlier>,
    air: Option<Outlier>,
}

impl Worst {
    /// HORUS restarts, or the run is over: its jitter is judged.
    ///
    /// A command that scatters makes the frame scatter, so of tick, command and air only the first that is out of its
    /// bound is told. The period is a figure and no more: it can only be as constant as ticks and frames are.
    pub(super) fn start_over(&mut self, jitter: &Jitter, layout: Layout, context: &Context) {
        let command = if context.worst_case() {
            bounds::TICK_TO_COMMAND_JITTER_PESSIMISTIC
        } else {
            bounds::TICK_TO_COMMAND_JITTER
        };
        if note(&mut self.ticks, jitter.ticks.beyond(bounds::TICK_WIDTH)) {
            return;
        }
        for (commands, airs) in jitter.command.iter().zip(&jitter.air).take(layout.frames()) {
            if !note(&mut self.command, commands.beyond(command)) {
                note(&mut self.air, airs.beyond(bounds::TICK_TO_AIR_JITTER));
            }
        }
    }

    pub(super) fn tell(&self, findings: &mut Findings) {
        let all = [
            (Violation::TickIrregular, self.ticks),
            (Violation::CommandJitter, self.command),
            (Violation::AirJitter, self.air),
        ];
        for (violation, outlier) in all {
            if let Some(Outlier { span, at, bound }) = outlier {
                findings.add(violation, at, || {
                    let (Span { min, max }, width) = (span, span.width());
                    format!("{min} to {max} ns, {width} ns peak to peak, the bound is {bound} ns")
                });
            }
        }
    }
}

/// Keeps the greater of two; whether there is a new one at all.
fn note(worst: &mut Option<Outlier>, new: Option<Outlier>) -> bool {
    if let Some(new) = new
        && worst.is_none_or(|worst| worst.span.width() < new.span.width())
    {
        *worst = Some(new);
    }
    new.is_some()
}
