//! The reference of the configuration, made from its types: `daemon config-reference`, `docs/configuration.md` and
//! `docs/configuration.schema.json`. A test compares the two files with it.

use crate::schema::{self, SCHEMA, properties, table};
use serde_json::Value;

/// The JSON schema, for editors.
pub fn json_schema() -> String {
    serde_json::to_string_pretty(&*SCHEMA).expect("a schema is a JSON document") + "\n"
}

/// Every table and key: type, unit, default, what is accepted, meaning, example; as Markdown.
pub fn markdown() -> String {
    let mut text = String::from(INTRODUCTION);
    text += &section("Without a table", "", &SCHEMA);
    for (name, schema) in properties(&SCHEMA).filter(|(_, schema)| table(schema).is_some()) {
        text += &section(&format!("`{}`", header(name, schema)), name, schema);
    }
    // The solver's table is the same in every channel.
    for (heading, path) in [
        ("`[translation.joint]`", "translation.joint"),
        ("`[rotation.joint]`", "rotation.joint"),
        ("`[translation.solver]`, `[rotation.solver]`, `[linear.solver]`", "translation.solver"),
    ] {
        text += &section(heading, path, schema::find(&SCHEMA, path).expect("the table of a channel"));
    }
    text
}

const INTRODUCTION: &str = r#"# Configuration

<!-- Made from the types in daemon/config; after a change there: UPDATE_REFERENCE=1 cargo test -p daemon_config -->

`daemon run --config FILE` reads one TOML file; `daemon run --preset NAME` a built-in one. Start from one of those, and ask
what is proven for yours before it flies:

    daemon config --preset rigid-body > vehicle.toml
    daemon check --config vehicle.toml

A key that is unknown, a value of another type or out of its bounds is refused with its line. Units are in the keys. At
least one of `[translation]`, `[rotation]`, `[linear]` must be there.

`[translation]` and `[rotation]` have one of two laws. `law = "joint"`, the default, needs the sensor's noise and the box of
speeds. `law = "gradient"` is the paper's; like `[linear]` it needs gains, and its centers either as a lattice,
`centers_lower…`, `centers_upper…` and `centers_per_axis`, or one by one, `centers_listed…`. A key that belongs to the other
law is refused; the column `law` says which has it.

Editors complete and check keys by [configuration.schema.json](configuration.schema.json); with taplo (Even Better TOML)
by a first line `#:schema PATH/configuration.schema.json`. `daemon config-reference` prints this text, with `--schema`
that file.
"#;

fn section(heading: &str, path: &str, schema: &Value) -> String {
    let mut text = format!("\n## {heading}\n");
    if !path.is_empty() {
        text += &format!("\n{}\n", description(schema));
    }
    let schema_table = table(schema).unwrap_or(schema);
    let alternatives = alternatives(schema_table);
    let has_laws = alternatives.iter().any(|alternative| !law(alternative).is_empty());
    let keys = properties(schema).filter(|(_, schema)| !path.is_empty() || table(schema).is_none());
    let law_column = |text: &str| if has_laws { format!(" {text} |") } else { String::new() };
    text += &format!("\n| key |{} type | unit | default | accepted |\n", law_column("law"));
    text += &format!("|---|{}---|---|---|---|\n", if has_laws { "---|" } else { "" });
    for (name, schema) in keys.clone() {
        let own: Vec<_> =
            alternatives.iter().filter(|alternative| !alternative["properties"][name].is_boolean()).collect();
        let laws = if own.len() == alternatives.len() { "" } else { own.first().map_or("", |own| law(own)) };
        let needs = |owner: &&Value| required_in(owner).contains(&name);
        let default = match schema.get("default") {
            Some(Value::Object(_)) => "a table of its own".into(),
            Some(value) => format!("`{}`", toml_text(value)),
            None if needs(&schema_table) || !own.is_empty() && own.iter().all(needs) => "required".into(),
            None if has_laws && own.iter().all(|owner| needs(owner) == (law(owner) == "gradient")) => {
                "required with `\"gradient\"`".into()
            }
            None => "absent".into(),
        };
        let (kind, unit) = (type_text(schema), unit(name));
        text += &format!(
            "| `{name}` |{} {kind} | {unit} | {default} | {} |\n",
            law_column(laws),
            accepted(schema)
        );
    }
    for (name, schema) in keys {
        text += &format!("\n**`{name}`**: {}\n", description(schema));
        if let Some(example) = example(schema).filter(|_| schema.get("default").is_none()) {
            text += &format!("Example: `{name} = {}`\n", toml_text(example));
        }
        for (word, meaning) in words(schema).filter_map(|(word, meaning)| Some((word, meaning?))) {
            text += &format!("- `\"{word}\"`: {meaning}\n");
        }
    }
    text + &format!("\n```toml\n{}```\n", whole_example(path, schema))
}

/// `[name]`, or `[[name]]` of one of several tables.
fn header(name: &str, schema: &Value) -> String {
    if schema["type"] == "array" { format!("[[{name}]]") } else { format!("[{name}]") }
}

/// A table as one may write it: what is required, or else all that there is.
fn whole_example(path: &str, schema: &Value) -> String {
    let required = required(schema);
    let mut text = if path.is_empty() { String::new() } else { header(path, schema) + "\n" };
    for (name, key) in properties(schema).filter(|(name, key)| {
        if path.is_empty() { table(key).is_none() } else { required.is_empty() || required.contains(name) }
    }) {
        if let Some(value) = example(key) {
            text += &format!("{name} = {}\n", toml_text(value));
        }
    }
    text
}

/// A value that a key accepts, its default first.
fn example(schema: &Value) -> Option<&Value> {
    schema.get("default").or_else(|| schema["examples"].get(0))
}

/// The keys that must be there, and those of the first alternative.
fn required(schema: &Value) -> Vec<&str> {
    let Some(table) = table(schema) else { return Vec::new() };
    let all = [required_in(table), alternatives(table).first().map(required_in).unwrap_or_default()].concat();
    properties(table).map(|(name, _)| name).filter(|name| all.contains(name)).collect()
}

/// The keys that a table, or an alternative of it, requires.
fn required_in(schema: &Value) -> Vec<&str> {
    schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect()
}

/// What a table says of its laws and centers: of each alternative the required keys, and as `false` those it may not have.
fn alternatives(table: &Value) -> &[Value] {
    table["oneOf"].as_array().map_or(&[], Vec::as_slice)
}

/// The law of an alternative; empty where there is but one.
fn law(alternative: &Value) -> &str {
    alternative["properties"]["law"]["const"].as_str().unwrap_or_default()
}

fn description(schema: &Value) -> String {
    schema["description"]
        .as_str()
        .unwrap_or_default()
        .replace("\n\n", "\u{0}")
        .replace('\n', " ")
        .replace('\u{0}', "\n\n")
}

fn toml_text(value: &Value) -> String {
    toml::Value::try_from(value).expect("a value without null").to_string()
}

/// The unit, which is the end of a key's name.
fn unit(key: &str) -> &'static str {
    const UNITS: [(&str, &str); 20] = [
        ("_rad_s_sqrt_s", "rad/s/√s"),
        ("_rad2_s3", "rad²/s³"),
        ("_m2_s3", "m²/s³"),
        ("_rad_s2", "rad/s²"),
        ("_kg_m2", "kg·m²"),
        ("_kg_s2", "kg/s²"),
        ("_rad_s", "rad/s"),
        ("_m_s2", "m/s²"),
        ("_m_s", "m/s"),
        ("_n_m", "N·m"),
        ("_per_s", "1/s"),
        ("_kg", "kg"),
        ("_hz", "Hz"),
        ("_us", "µs"),
        ("_s", "s"),
        ("_m", "m"),
        ("_n", "N"),
        ("_ticks", "ticks"),
        ("_samples", "samples"),
        ("_rad", "rad"),
    ];
    UNITS.iter().find(|(end, _)| key.ends_with(end)).map_or("", |(_, unit)| unit)
}

/// A schema's words and what they mean.
fn words(schema: &Value) -> impl Iterator<Item = (&str, Option<&str>)> {
    let alternatives = ["anyOf", "oneOf"].map(|key| schema[key].as_array().into_iter().flatten());
    let nested = alternatives.into_iter().flatten().flat_map(|inner| {
        let further = inner["oneOf"].as_array().into_iter().flatten();
        std::iter::once(inner).chain(further)
    });
    nested.filter_map(|word| Some((word["const"].as_str()?, word["description"].as_str())))
}

fn type_text(schema: &Value) -> String {
    if let Some(alternatives) = schema["anyOf"].as_array() {
        return alternatives.iter().map(type_text).collect::<Vec<_>>().join(", or ");
    }
    match schema["type"].as_str() {
        Some("array") => several(schema),
        Some("object") => "table".into(),
        Some("boolean") => "true or false".into(),
        Some("string") => "word".into(),
        Some(name) => name.into(),
        None => "word".into(),
    }
}

/// The type of an array: `3 numbers`, `rows of numbers`.
fn several(schema: &Value) -> String {
    let count = schema["minItems"].as_u64().filter(|n| schema["maxItems"].as_u64() == Some(*n));
    let items = &schema["items"];
    let what = match items["type"].as_str() {
        Some("array") => format!("rows of {}", several(items)),
        Some(name) => format!("{name}s"),
        None => "values".into(),
    };
    count.map_or(what.clone(), |count| format!("{count} {what}"))
}

/// What a number outside of its bounds is answered with: the bounds and the unit.
pub fn bounds_in_words(key: &str, schema: &Value) -> String {
    let bounds = accepted(schema);
    let number = if bounds.contains('…') { "" } else { "a finite number " };
    match unit(key) {
        "" => format!("{number}{bounds}"),
        unit => format!("{number}{bounds} (in {unit})"),
    }
}

/// Bounds, or the words.
fn accepted(schema: &Value) -> String {
    let words: Vec<_> = words(schema).map(|(word, _)| format!("`\"{word}\"`")).collect();
    if !words.is_empty() {
        return words.join(", ");
    }
    if let Some(pattern) = schema["pattern"].as_str() {
        let named = |word: &str| format!("`\"{}\"`", word.replace("[0-9]+", "K"));
        let words = pattern.trim_start_matches("^(").trim_end_matches(")$").split('|');
        return words.map(named).collect::<Vec<_>>().join(", ");
    }
    let bound = |key: &str| schema[key].as_f64();
    let parts =
        match (bound("minimum"), bound("maximum"), bound("exclusiveMinimum"), bound("exclusiveMaximum")) {
            (Some(low), Some(high), _, _) => format!("{low} … {high}"),
            (Some(low), _, _, Some(high)) => format!("{low} … below {high}"),
            (Some(low), ..) => format!("≥ {low}"),
            (_, _, Some(low), _) => format!("> {low}"),
            _ => String::new(),
        };
    match schema["multipleOf"].as_u64() {
        Some(2) => format!("{parts}, even"),
        _ => parts,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn the_files_in_docs_are_those_of_the_types() {
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        for (name, made) in [("configuration.md", markdown()), ("configuration.schema.json", json_schema())] {
            let path = docs.join(name);
            if std::env::var_os("UPDATE_REFERENCE").is_some() {
                std::fs::write(&path, &made).unwrap();
            }
            let file = std::fs::read_to_string(&path).unwrap_or_default();
            assert!(
                file == made,
                "docs/{name} is not that of the types; look at the difference that UPDATE_REFERENCE=1 makes"
            );
        }
    }
}
