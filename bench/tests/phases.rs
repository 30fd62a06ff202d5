mod boards;
use bench::sim::phases::{Edge, Placement, Sweep};
use bench::sim::{Crystals, Faults, Images, Setup, run};
use boards::image;

#[test]
fn probe() {
    let gps: usize = std::env::var("GPS").map_or(3, |s| s.parse().unwrap());
    let v = |n: &str, d: i64| std::env::var(n).map_or(d, |s| s.parse().unwrap());
    let whole = |edge, after_ns| Placement { edge, after_ns, bytes: None };
    let short = |edge, after_ns| Placement { edge, after_ns, bytes: Some(96) };
    let late = short(Edge::Falls, 700_000);
    let sweep = Sweep {
        frame: v("FRAME", 0) as usize,
        from_ns: v("FROM", -60_000),
        to_ns: v("TO", 240_000),
        step_ns: v("STEP", 100) as u64,
        patterns: vec![
            vec![whole(Edge::Rises, 0), short(Edge::Falls, v("GAP", 11_000)), late],
            vec![short(Edge::Falls, 0), late],
        ],
    };
    let setup = Setup {
        images: Images { horus: image(gps, "horus-tx-fw.elf").unwrap(), dpr: image(gps, "dpr-fw.elf").unwrap() },
        gps,
        duration_ns: (sweep.cycles() + 5) * 10_000_000,
        seed: 1,
        recordings: vec![],
        crystals: Crystals { horus_ppb: v("HPPB", 200_000), dpr_ppb: v("DPPB", -200_000), flight_controller_ppb: 0 },
        faults: Faults::default(),
        sweep: Some(sweep.clone()),
        trace: None,
    };
    let began = std::time::Instant::now();
    let outcome = run(&setup, &mut ()).unwrap();
    println!("{} phases of {} in {:?}", outcome.phases.len(), sweep.cycles(), began.elapsed());
    println!("{:#?}", outcome.report.violations);
    println!("{:?} {:?}", outcome.report.ssi, outcome.report.latency_ns);
    let mut shown = std::collections::BTreeMap::new();
    for phase in &outcome.phases {
        // derive
        let mut rises = None;
        let mut held = None;
        let (mut ready, mut hold) = (0, 0);
        let mut fresh = None;
        for &(at, what) in &phase.events {
            match what {
                "CSN rises" => rises = Some(at),
                "SPIS ready" => {
                    if let Some(r) = rises.take() {
                        ready = ready.max(at - r);
                    }
                }
                "SPIS held" => held = Some(at),
                "SPIS released" => {
                    if let Some(h) = held.take() {
                        hold = hold.max(at - h);
                    }
                }
                "FRESH rises" => {
                    fresh.get_or_insert(at);
                }
                _ => {}
            }
        }
        let mut tags: Vec<String> = phase.violations.iter().map(|v| v.to_string()).collect();
        if ready > 6_000 {
            tags.push(format!("ready {} us", ready / 1000));
        }
        if hold > 6_000 {
            tags.push(format!("hold {} us", hold / 1000));
        }
        if fresh.is_none_or(|f| f > 95_000) {
            tags.push(format!("fresh {:?} us", fresh.map(|f| f / 1000)));
        }
        for tag in tags {
            let e = shown.entry((phase.pattern, tag)).or_insert((vec![], phase.clone()));
            e.0.push((phase.phase_ns, fresh));
        }
    }
    for ((pattern, tag), (list, phase)) in shown {
        println!("pattern {pattern} {tag}: {} x, {:?} .. {:?}", list.len(), list.first(), list.last());
        println!("   e.g. {:?}", phase.events);
    }
}
