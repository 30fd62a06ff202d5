//! Draws four panels: ground track, height, distance from the true position, and time from sample to readable.
//! Coordinates are whole pixels and text stays text, so the same numbers give the same file on every machine.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::Place;

pub(super) type Error = Box<dyn std::error::Error>;

type Panel<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

const WIDTH: u32 = 1_000;
const TRACK_HEIGHT: u32 = 720;
const PANEL_HEIGHT: u32 = 280;
/// The greatest number of points of a line. More points would not be visible, because a line has fewer pixels than
/// this.
const MOST_POINTS: usize = 2_000;
const LEAST_M: f64 = 20.0;

pub(super) struct Drawn {
    pub(super) seconds: f64,
    pub(super) truth: Option<Place>,
    pub(super) said: [Option<Place>; 1 + profile::MAX_RECEIVERS],
    pub(super) excluded: u8,
    pub(super) latency_ms: Option<f64>,
}

/// The colours of Reported-Position and GPS1 to GPS5. They are by Okabe and Ito, and colour-blind readers can
/// distinguish them.
const COLOURS: [RGBColor; 1 + profile::MAX_RECEIVERS] = [
    RGBColor(0x00, 0x00, 0x00),
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0xD5, 0x5E, 0x00),
    RGBColor(0x00, 0x9E, 0x73),
    RGBColor(0xCC, 0x79, 0xA7),
    RGBColor(0xE6, 0x9F, 0x00),
];
const TRUTH: RGBColor = RGBColor(0x99, 0x99, 0x99);
const GRID: RGBColor = RGBColor(0xE4, 0xE4, 0xE4);

pub(super) fn svg(title: &str, receivers: usize, cycles: &[Drawn]) -> Result<String, Error> {
    let mut text = String::new();
    {
        let height = TRACK_HEIGHT + 3 * PANEL_HEIGHT;
        let root = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.titled(title, ("sans-serif", 22))?;
        let (track, panels) = root.split_vertically(TRACK_HEIGHT);
        ground_track(&track, receivers, cycles)?;
        let [height, distance, latency] = &panels.split_evenly((3, 1))[..] else { return Ok(String::new()) };
        over_time(height, "Height above the ellipsoid", receivers, cycles, |said, _| said[2])?;
        let from = if cycles.iter().any(|cycle| cycle.truth.is_some()) { "the aircraft" } else { "the first position" };
        let words = format!("Distance from {from} along the ground");
        over_time(distance, &words, receivers, cycles, |said, truth| along(said, truth.unwrap_or_default()))?;
        readable(latency, cycles)?;
        root.present()?;
    }
    Ok(text)
}

fn along(one: Place, other: Place) -> f64 {
    (one[0] - other[0]).hypot(one[1] - other[1])
}

fn range(values: impl Iterator<Item = f64>, least: f64) -> Range<f64> {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return -least / 2.0..least / 2.0;
    }
    let half = ((high - low) * 1.08).max(least) / 2.0;
    let middle = f64::midpoint(low, high);
    middle - half..middle + half
}

fn pieces(points: impl Iterator<Item = Option<(f64, f64)>>) -> Vec<Vec<(f64, f64)>> {
    let mut pieces = vec![vec![]];
    for point in points {
        match point.filter(|(x, y)| x.is_finite() && y.is_finite()) {
            Some(point) => pieces.last_mut().expect("one").push(point),
            None if pieces.last().is_some_and(|piece| !piece.is_empty()) => pieces.push(vec![]),
            None => {}
        }
    }
    pieces.retain(|piece| !piece.is_empty());
    pieces
}

fn thinned(cycles: &[Drawn]) -> impl Iterator<Item = &Drawn> {
    cycles.iter().step_by(cycles.len().div_ceil(MOST_POINTS).max(1))
}

fn line(
    chart: &mut Chart<'_>,
    name: &str,
    style: ShapeStyle,
    points: impl Iterator<Item = Option<(f64, f64)>>,
) -> Result<(), Error> {
    let mut named = false;
    for piece in pieces(points) {
        let drawn = chart.draw_series(LineSeries::new(piece, style))?;
        if !named {
            drawn.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], style));
            named = true;
        }
    }
    Ok(())
}

fn name(object: usize) -> String {
    if object == 0 { "Reported-Position".to_owned() } else { format!("GPS{object}") }
}

/// The objects with their line styles. Reported-Position comes last, so that its line lies on top.
fn objects(receivers: usize) -> impl Iterator<Item = (usize, ShapeStyle)> {
    (1..=receivers).chain([0]).map(|object| (object, COLOURS[object].stroke_width(if object == 0 { 3 } else { 1 })))
}

fn legend(chart: &mut Chart<'_>) -> Result<(), Error> {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.9))
        .border_style(BLACK.mix(0.3))
        .label_font(("sans-serif", 13))
        .draw()?;
    Ok(())
}

fn chart<'a>(
    area: &Panel<'a>,
    title: &str,
    (x, x_words): (Range<f64>, &str),
    (y, y_words): (Range<f64>, &str),
) -> Result<Chart<'a>, Error> {
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 17))
        .margin(10)
        .x_label_area_size(38)
        .y_label_area_size(66)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(GRID)
        .x_desc(x_words)
        .y_desc(y_words)
        .label_style(("sans-serif", 13))
        .draw()?;
    Ok(chart)
}

fn ground_track(area: &Panel<'_>, receivers: usize, cycles: &[Drawn]) -> Result<(), Error> {
    let all = || cycles.iter().flat_map(|cycle| cycle.said.iter().take(1).flatten().chain(&cycle.truth));
    let north = range(all().map(|place| place[0]), LEAST_M);
    let east = range(all().map(|place| place[1]), LEAST_M);
    // Both axes get the same scale for a chart of about this size.
    let (width, height) = (f64::from(WIDTH) - 86.0, f64::from(TRACK_HEIGHT) - 86.0);
    let metres = ((north.end - north.start) / height).max((east.end - east.start) / width);
    let around = |range: &Range<f64>, pixels: f64| {
        let middle = f64::midpoint(range.start, range.end);
        middle - metres * pixels / 2.0..middle + metres * pixels / 2.0
    };
    let (east, north) = (around(&east, width), around(&north, height));
    let inside = |place: Place| (east.contains(&place[1]) && north.contains(&place[0])).then_some((place[1], place[0]));
    let mut chart = chart(area, "Ground track", (east.clone(), "east, m"), (north.clone(), "north, m"))?;
    let truth = thinned(cycles).map(|cycle| cycle.truth.and_then(inside));
    line(&mut chart, "the aircraft", TRUTH.stroke_width(7), truth)?;
    for (object, style) in objects(receivers) {
        line(&mut chart, &name(object), style, thinned(cycles).map(|cycle| cycle.said[object].and_then(inside)))?;
    }
    legend(&mut chart)
}

fn over_time(
    area: &Panel<'_>,
    title: &str,
    receivers: usize,
    cycles: &[Drawn],
    value: impl Fn(Place, Option<Place>) -> f64,
) -> Result<(), Error> {
    let of = |cycle: &Drawn, object: usize| cycle.said[object].map(|said| value(said, cycle.truth));
    let x = range(cycles.iter().map(|cycle| cycle.seconds), 0.1);
    // The true position determines the chart's range. A receiver far outside is drawn at the edge.
    let shown = cycles.iter().flat_map(|cycle| {
        let truth = cycle.truth.map(|truth| value(truth, Some(truth)));
        let said = (0..=receivers).filter(|object| *object == 0 || cycle.truth.is_none());
        truth.into_iter().chain(said.filter_map(|object| of(cycle, object))).collect::<Vec<_>>()
    });
    let mut y = range(shown, LEAST_M);
    if y.start < 0.0 && y.end > 0.0 {
        y = -1.0..y.end - y.start - 1.0;
    }
    let mut chart = chart(area, title, (x, "s"), (y.clone(), "m"))?;
    for (receiver, colour) in COLOURS.iter().enumerate().take(receivers + 1).skip(1) {
        for span in excluded(cycles, receiver) {
            let style = colour.mix(0.2).filled();
            chart.draw_series([Rectangle::new([(span.start, y.start), (span.end, y.end)], style)])?;
        }
    }
    let truth = thinned(cycles).map(|cycle| cycle.truth.map(|truth| (cycle.seconds, value(truth, Some(truth)))));
    line(&mut chart, "the aircraft", TRUTH.stroke_width(5), truth)?;
    for (object, style) in objects(receivers) {
        let points = thinned(cycles).map(|cycle| {
            let value = of(cycle, object).filter(|value| value.is_finite())?;
            Some((cycle.seconds, value.clamp(y.start, y.end)))
        });
        line(&mut chart, &name(object), style, points)?;
    }
    legend(&mut chart)
}

fn excluded(cycles: &[Drawn], receiver: usize) -> Vec<Range<f64>> {
    let mut spans: Vec<Range<f64>> = vec![];
    let mut was = false;
    for cycle in cycles {
        let is = cycle.excluded & 1 << (receiver - 1) != 0;
        match spans.last_mut() {
            Some(span) if was => span.end = cycle.seconds,
            _ if is => spans.push(cycle.seconds..cycle.seconds),
            _ => {}
        }
        was = is;
    }
    spans
}

/// Draws the time from sample to readable. A point that stands for several cycles has the longest of their times.
fn readable(area: &Panel<'_>, cycles: &[Drawn]) -> Result<(), Error> {
    let x = range(cycles.iter().map(|cycle| cycle.seconds), 0.1);
    let group = cycles.len().div_ceil(MOST_POINTS).max(1);
    let longest: Vec<_> = cycles
        .chunks(group)
        .map(|group| {
            let longest = group.iter().filter_map(|cycle| cycle.latency_ms).fold(f64::NEG_INFINITY, f64::max);
            longest.is_finite().then_some((group[0].seconds, longest))
        })
        .collect();
    let y = range(longest.iter().flatten().map(|(_, ms)| *ms), 0.2);
    let mut chart = chart(area, "Sample to readable, ms", (x, "s"), (y, "ms"))?;
    line(&mut chart, "each cycle", COLOURS[1].stroke_width(1), longest.into_iter())?;
    Ok(())
}
