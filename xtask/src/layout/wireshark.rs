//! Writes the dissector for Wireshark. `dissector.lua`, which is written by hand, has a place for a table of Lua. The
//! description in JSON becomes that table.

use anyhow::{Context, Result, ensure};
use serde_json::Value;

pub(super) const PATH: &str = "wireshark/horus.lua";

/// The parts of the layout's description that the Wireshark dissector needs.
const PARTS: [&str; 9] = [
    "commands",
    "crcs",
    "enumerations",
    "identifiers",
    "maps",
    "objects",
    "solution_age",
    "status_words",
    "violations",
];

pub(super) fn dissector() -> Result<String> {
    let description: Value = serde_json::from_str(&super::json::description()?)?;
    let mut layout = serde_json::Map::new();
    for part in PARTS {
        layout.insert(part.to_owned(), description.get(part).with_context(|| format!("no {part}"))?.clone());
    }
    let template = include_str!("dissector.lua");
    ensure!(template.matches("@layout@").count() == 1, "the dissector has no single place for the layout");
    Ok(template.replace("@layout@", &lua(&Value::Object(layout), 0)))
}

/// Returns the value in Lua's syntax, on one line if it fits.
fn lua(value: &Value, depth: usize) -> String {
    let entries: Vec<String> = match value {
        Value::Array(values) => values.iter().map(|value| lua(value, depth + 1)).collect(),
        Value::Object(values) => {
            values.iter().map(|(key, value)| format!("{key} = {}", lua(value, depth + 1))).collect()
        }
        other => return other.to_string(),
    };
    let line = format!("{{ {} }}", entries.join(", "));
    let indent = "  ".repeat(depth);
    if indent.len() + line.len() < 110 && !line.contains('\n') {
        return line;
    }
    let lines: Vec<_> = entries.iter().map(|entry| format!("{indent}  {entry},\n")).collect();
    format!("{{\n{}{indent}}}", lines.concat())
}
