//! Plots the probability of an undetected error, P_ud, over the bit error rate as SVG: a panel for each length in use,
//! a line for each polynomial, and the bounds.
//!
//! Coordinates are whole pixels and text stays text, so the drawing is the same on every machine.
use std::error::Error;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::codes::{self, Named};
use crate::rate::{self, Sil};
use crate::{Code, ErrorCurve, logarithmic};

const WIDTH: u32 = 960;
const PANEL_HEIGHT: u32 = 520;
const X: std::ops::Range<f64> = -6.0..-0.301;
const Y: std::ops::Range<f64> = -30.0..-2.0;
const RECEIVERS: u32 = 3;

/// The colours of the polynomials' lines are those of Okabe and Ito, which colour-blind readers can distinguish.
const fn colour(named: Named) -> RGBColor {
    match named.polynomial.koopman() {
        0xF8C9_140A => RGBColor(0xD5, 0x5E, 0x00),
        0x9D7F_97D6 => RGBColor(0x00, 0x72, 0xB2),
        0x8260_8EDB => RGBColor(0x99, 0x99, 0x99),
        0x8F6E_37A0 => RGBColor(0x00, 0x9E, 0x73),
        0xC0A0_A0D5 => RGBColor(0xCC, 0x79, 0xA7),
        _ => RGBColor(0xB8, 0x9A, 0x00),
    }
}

/// Draws the curves of all codes at the lengths that are compared.
///
/// # Errors
///
/// The plotting library reports an error, which is not expected, because it draws into a string.
pub fn svg(curves: &[(Code, ErrorCurve)]) -> Result<String, Box<dyn Error>> {
    let mut text = String::new();
    {
        let titles = [
            (codes::POSITION_BITS, "Latitude, longitude and their CRC: codewords of 160 bits"),
            (codes::GPS_BITS, "GPS object: codewords of 480 bits"),
            (codes::REPORTED_BITS, "Reported-Position: codewords of 512 bits"),
        ];
        let root = SVGBackend::with_string(&mut text, (WIDTH, PANEL_HEIGHT * titles.len() as u32)).into_drawing_area();
        root.fill(&WHITE)?;
        for ((bits, title), area) in titles.into_iter().zip(root.split_evenly((titles.len(), 1))) {
            panel(&area, title, curves.iter().filter(|(code, _)| code.bits == bits))?;
        }
        root.present()?;
    }
    Ok(text)
}

fn panel<'a>(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    title: &str,
    curves: impl Iterator<Item = &'a (Code, ErrorCurve)>,
) -> Result<(), Box<dyn Error>> {
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 20))
        .margin(14)
        .x_label_area_size(46)
        .y_label_area_size(76)
        .build_cartesian_2d(X, Y)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(0xE4, 0xE4, 0xE4))
        .x_labels(6)
        .y_labels(15)
        .x_label_formatter(&|x| format!("1e{x:.0}"))
        .y_label_formatter(&|y| format!("1e{y:.0}"))
        .x_desc("bit error rate p")
        .y_desc("P undetected")
        .label_style(("sans-serif", 14))
        .draw()?;

    let share = |sil: Sil| sil.channel_limit() / (rate::CYCLES_PER_HOUR * f64::from(RECEIVERS + 1));
    let bounds = [
        (rate::OPC_UA_SAFETY_CONDITIONAL, "OPC UA Safety, P re,cond ≤ 4.0e-10".to_owned()),
        (share(Sil::Two), format!("SIL 2, share of one object of {}", RECEIVERS + 1)),
        (share(Sil::Three), "SIL 3, likewise".to_owned()),
        (share(Sil::Four), "SIL 4, likewise".to_owned()),
    ];
    // The labels of two bounds overlap if they are closer than the height of a line of text. So one label is moved to
    // the right.
    for (i, (bound, label)) in bounds.into_iter().enumerate() {
        let y = bound.log10();
        chart.draw_series(DashedLineSeries::new([(X.start, y), (X.end, y)], 8, 6, BLACK.mix(0.7).stroke_width(1)))?;
        let x = match i {
            0 => -5.0,
            2 => -4.4,
            _ => X.start + 0.04,
        };
        let style = TextStyle::from(("sans-serif", 12)).pos(Pos::new(HPos::Left, VPos::Bottom));
        chart.draw_series([Text::new(label, (x, y + 0.08), style)])?;
    }
    chart.draw_series(DashedLineSeries::new([(-2.0, Y.start), (-2.0, Y.end)], 2, 4, BLACK.mix(0.7).stroke_width(1)))?;
    let style = TextStyle::from(("sans-serif", 12)).pos(Pos::new(HPos::Right, VPos::Bottom));
    chart.draw_series([Text::new("IEC 61784-3, p = 1e-2", (-2.04, Y.start + 0.2), style)])?;

    for (code, curve) in curves {
        let colour = colour(code.named);
        let own = code.named == codes::FRAME || code.named == codes::POSITION;
        let style = colour.stroke_width(if own { 3 } else { 2 });
        let points: Vec<(f64, f64)> =
            logarithmic(60).map(|p| (p.log10(), curve.undetected(p).log10())).filter(|(_, y)| *y >= Y.start).collect();
        chart
            .draw_series(LineSeries::new(points, style))?
            .label(format!("{} ({})", code.named.name, code.named.polynomial))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], style));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::Coordinate(616, 230))
        .background_style(WHITE.mix(0.9))
        .border_style(BLACK.mix(0.3))
        .label_font(("sans-serif", 14))
        .draw()?;
    Ok(())
}
