//! Reads traces with `wellen`, the library of the viewer Surfer.

use std::collections::BTreeMap;
use std::path::Path;

/// Returns the changes of each signal in the trace file, by group and name. A change has its instant (ns) and its value
/// in binary.
pub(crate) fn read(path: &Path) -> BTreeMap<String, Vec<(u64, String)>> {
    let mut wave = wellen::simple::read(path).unwrap();
    let variables: Vec<_> = {
        let hierarchy = wave.hierarchy();
        let unit = hierarchy.timescale().unwrap();
        assert_eq!((unit.factor, unit.unit), (1, wellen::TimescaleUnit::NanoSeconds));
        hierarchy
            .all_vars()
            .map(|variable| (hierarchy[variable].full_name(hierarchy), hierarchy[variable].signal_ref()))
            .collect()
    };
    let signals: Vec<_> = variables.iter().map(|(_, signal)| *signal).collect();
    wave.load_signals(&signals);
    let mut waves = BTreeMap::new();
    for (name, signal) in variables {
        let signal = wave.get_signal(signal).unwrap();
        let changes = signal
            .iter_changes()
            .map(|(index, value)| (wave.time_table()[index as usize], value.to_bit_string().unwrap()))
            .collect();
        assert!(waves.insert(name.clone(), changes).is_none(), "{name} comes twice");
    }
    waves
}
