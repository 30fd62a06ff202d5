//! Draws one cycle of the boards' tasks as a picture, and writes a run for a trace viewer.

use bench_judge::{HoldEvent, Log, What};
use serde_json::json;

use crate::search::{Run, Shown};
use crate::tasks::Table;

/// A bar of a chart, with its name, its beginning and its end (ns).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bar {
    /// The bar's name.
    pub name: String,
    /// The beginning of the bar, ns.
    pub from: u64,
    /// The end of the bar, ns.
    pub to: u64,
}

/// A lane of a chart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lane {
    /// The group of the lane: a board, the air, or the SSI.
    pub group: String,
    /// The lane's name.
    pub name: String,
    /// The lane's bars, in order of time.
    pub bars: Vec<Bar>,
}

/// Returns the lanes of a run that was observed with spans: HORUS's tasks by priority, the air, the DPR's tasks, the
/// SSI, and the tasks and the air of a hold.
#[must_use]
pub fn lanes(run: &Run, shown: &Shown) -> Vec<Lane> {
    let mut lanes = vec![];
    let tables = run.tables();
    for (place, (table, seen)) in tables.iter().zip(&shown.boards).enumerate() {
        let board = if place == 1 { "DPR" } else { table.board };
        for level in (1..=table.tasks.iter().map(|task| task.level).max().unwrap_or(0)).rev() {
            let of_level = |exception: u16| {
                let mut tasks = table.tasks.iter().zip(&seen.exceptions);
                tasks.find(|(task, its)| **its == exception && task.level == level).map(|(task, _)| task.name)
            };
            let bars = seen
                .spans
                .iter()
                .filter_map(|&(exception, from, to)| Some(Bar { name: of_level(exception)?.to_owned(), from, to }));
            lanes.push(Lane { group: board.to_owned(), name: stems(table, level), bars: bars.collect() });
        }
        if place < 2
            && let Some(log) = &shown.log
        {
            let (group, name) = if place == 0 { ("air", "frames") } else { ("SSI", "transactions") };
            lanes.push(Lane { group: group.to_owned(), name: name.to_owned(), bars: of_log(log, place) });
        }
    }
    if let Some(log) = shown.log.as_ref().filter(|_| run.setup.hold.is_some()) {
        lanes.push(Lane { group: "air".to_owned(), name: "hold".to_owned(), bars: of_log(log, 2) });
    }
    lanes
}

/// Returns the bars of some events in the log. The number selects them: 0 HORUS's frames, 1 transactions and FRESH, 2
/// the hold's frames and answers.
fn of_log(log: &Log, which: usize) -> Vec<Bar> {
    let bars = log.events.iter().filter_map(|event| {
        let (name, from) = match (&event.what, which) {
            (What::Heard { started, .. }, 0) => ("frame", *started),
            (What::Transaction { selected, .. }, 1) => ("transaction", *selected),
            (What::Hold(HoldEvent::Heard(frame)), 2) => ("frame of the hold", frame.started),
            (What::Hold(HoldEvent::Answered(frame)), 2) => ("answer", frame.started),
            _ => return None,
        };
        Some(Bar { name: name.to_owned(), from, to: event.at })
    });
    bars.collect()
}

/// Returns the names of the tasks of a priority, each up to its first `_` or digit: `rf` for `rf_spi`.
fn stems(table: &Table, level: u8) -> String {
    let mut stems: Vec<&str> = vec![];
    for task in table.tasks.iter().filter(|task| task.level == level) {
        let stem = task.name.split(|letter: char| !letter.is_ascii_alphabetic()).next().unwrap_or(task.name);
        if !stems.contains(&stem) {
            stems.push(stem);
        }
    }
    stems.join(", ")
}

/// Returns the beginning and the end, ns, of the cycle with the longest time from a frame's last bit to FRESH; `None`
/// if FRESH announced no frame.
#[must_use]
pub fn worst_cycle(log: &Log) -> Option<(u64, u64)> {
    let (mut tick, mut heard, mut worst) = (None, None, None);
    // The link is up after half a second.
    for event in log.events.iter().filter(|event| event.at > 500_000_000) {
        match event.what {
            What::Tick => tick = Some(event.at),
            What::Heard { .. } => heard = tick.map(|tick| (tick, event.at)),
            What::Fresh { high: true, .. } => {
                if let Some((tick, heard)) = heard.take() {
                    worst = worst.max(Some((event.at - heard, tick)));
                }
            }
            _ => {}
        }
    }
    worst.map(|(_, tick)| (tick, tick + 10_000_000))
}

/// Draws the lanes from `from` to `to` (ns) as SVG, with a scale in ms.
#[must_use]
pub fn svg(lanes: &[Lane], (from, to): (u64, u64), title: &str) -> String {
    const LEFT: f64 = 170.0;
    const WIDTH: f64 = 1_000.0;
    const LANE: f64 = 18.0;
    const TOP: f64 = 34.0;
    let x = |at: u64| LEFT + (at.clamp(from, to) - from) as f64 * WIDTH / (to - from) as f64;
    let height = TOP + LANE * lanes.len() as f64 + 30.0;
    let full = LEFT + WIDTH + 20.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {full:.0} {height:.0}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
         <text x=\"10\" y=\"20\" font-size=\"13\">{title}</text>\n"
    );
    let bottom = TOP + LANE * lanes.len() as f64;
    for ms in 0..=(to - from) / 1_000_000 {
        let at = x(from + ms * 1_000_000);
        svg += &format!(
            "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"#ddd\"/>\
             <text x=\"{at:.1}\" y=\"{:.0}\" text-anchor=\"middle\">{ms} ms</text>\n",
            bottom + 16.0
        );
    }
    for (number, lane) in lanes.iter().enumerate() {
        let y = TOP + LANE * number as f64;
        let colour = match lane.group.as_str() {
            "HORUS" => "#b5482a",
            "DPR" => "#2a6db5",
            "hold" => "#5a8f3c",
            _ => "#777",
        };
        svg += &format!("<text x=\"10\" y=\"{:.0}\">{}: {}</text>\n", y + 13.0, lane.group, lane.name);
        let mut path = String::new();
        for bar in lane.bars.iter().filter(|bar| bar.to > from && bar.from < to) {
            // A bar of 10 µs would be a hundredth of a pixel wide.
            let width = (x(bar.to) - x(bar.from)).max(0.6);
            path += &format!("M{:.1} {:.0}h{width:.1}v12h-{width:.1}z", x(bar.from), y + 3.0);
        }
        if !path.is_empty() {
            svg += &format!("<path d=\"{path}\" fill=\"{colour}\"/>\n");
        }
    }
    svg + "</svg>\n"
}

/// Returns the lanes in the Chrome trace event format, which Perfetto reads. A process stands for a group, a thread for
/// a lane, and an event for a bar; times are in µs.
#[must_use]
pub fn chrome_trace(lanes: &[Lane]) -> String {
    let mut groups: Vec<&str> = vec![];
    let mut events = vec![];
    for (thread, lane) in lanes.iter().enumerate() {
        let process = groups.iter().position(|group| *group == lane.group).unwrap_or_else(|| {
            groups.push(&lane.group);
            groups.len() - 1
        });
        let named =
            |what, name: &str| json!({"ph": "M", "pid": process, "tid": thread, "name": what, "args": {"name": name}});
        events.push(named("process_name", &lane.group));
        events.push(named("thread_name", &lane.name));
        for bar in &lane.bars {
            let (at, lasts) = (bar.from as f64 / 1e3, (bar.to - bar.from) as f64 / 1e3);
            events.push(json!({"ph": "X", "pid": process, "tid": thread, "name": bar.name, "ts": at, "dur": lasts}));
        }
    }
    json!({"traceEvents": events, "displayTimeUnit": "ns"}).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lane(group: &str, name: &str, bars: &[(u64, u64)]) -> Lane {
        let bar = |&(from, to): &(u64, u64)| Bar { name: name.to_owned(), from, to };
        Lane { group: group.to_owned(), name: name.to_owned(), bars: bars.iter().map(bar).collect() }
    }

    #[test]
    fn a_trace_has_each_bar_in_its_lane_with_times_in_microseconds() {
        let text = chrome_trace(&[lane("HORUS", "slot", &[(1_500, 4_000)]), lane("air", "frames", &[(0, 10)])]);
        let trace: serde_json::Value = serde_json::from_str(&text).unwrap();
        let bars: Vec<_> = trace["traceEvents"].as_array().unwrap().iter().filter(|event| event["ph"] == "X").collect();
        assert_eq!(bars.len(), 2);
        assert_eq!((&bars[0]["ts"], &bars[0]["dur"]), (&json!(1.5), &json!(2.5)));
        assert_ne!(bars[0]["pid"], bars[1]["pid"]);
    }

    #[test]
    fn a_chart_draws_what_lies_in_its_window_and_nothing_else() {
        let window = (1_000_000, 3_000_000);
        let drawn = |bars| svg(&[lane("DPR", "rf", bars)], window, "a cycle").matches("v12h").count();
        assert_eq!((drawn(&[(0, 10)]), drawn(&[(999_990, 1_000_010), (2_000_000, 2_000_001)])), (0, 2));
    }

    #[test]
    fn the_names_of_a_lane_are_those_of_its_tasks_without_endings() {
        assert_eq!(stems(&Table::dpr(true), 5), "rf");
        assert_eq!(stems(&Table::horus(3), 3), "cycle, vote");
    }
}
