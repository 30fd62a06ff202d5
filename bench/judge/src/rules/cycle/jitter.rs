//! Keeps the least and the greatest value of each series of times, and judges the jitter between two starts of HORUS.

use profile::Layout;

use crate::{Context, Findings, Span, Violation, bounds};

/// A time, and the instant, ns, at which it occurred.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    value: u64,
    at: u64,
}

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

    /// Returns the span of the times, and the least or the greatest time, whichever is farther from the mean. Returns
    /// `None` if the span is at most `bound`.
    fn beyond(&self, bound: u64) -> Option<Outlier> {
        let (min, max) = self.extremes?;
        let span = self.span().filter(|span| span.width() > bound)?;
        // The sums are twice the distances from the mean, so that they are whole numbers.
        let low = 2 * self.sum > u128::from(self.count) * u128::from(min.value + max.value);
        Some(Outlier { span, at: if low { min.at } else { max.at }, bound })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Outlier {
    span: Span,
    at: u64,
    bound: u64,
}

/// The times whose jitter is judged. The first and the second frame of a cycle have separate series.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Jitter {
    pub(super) ticks: Series,
    pub(super) command: [Series; 2],
    pub(super) air: [Series; 2],
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Worst {
    ticks: Option<Outlier>,
    command: Option<Outlier>,
    air: Option<Outlier>,
}

impl Worst {
    /// Judges the jitter since HORUS's last start, at its next start or the end of the run.
    ///
    /// A late tick also makes its command and its frame late. Therefore only the first of tick, command and air whose
    /// spread exceeds its bound is reported. The time between cycles scatters at least as much and is not judged.
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

fn note(worst: &mut Option<Outlier>, new: Option<Outlier>) -> bool {
    if let Some(new) = new
        && worst.is_none_or(|worst| worst.span.width() < new.span.width())
    {
        *worst = Some(new);
    }
    new.is_some()
}
