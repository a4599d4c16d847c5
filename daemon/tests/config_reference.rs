//! The reference and the schema of the configuration agree with the behaviour of the service.

use daemon::assemble;
use daemon::config::{ConfigFile, PRESETS, reference};
use serde_json::{Value, json};

fn schema() -> Value {
    serde_json::from_str(&reference::json_schema()).unwrap()
}

/// The faults of a value by a schema of the kind that is made here. An unknown keyword of the schema is a failure.
fn faults(schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let mut found = Vec::new();
    if *schema == json!(false) {
        return vec![format!("{at} belongs to the other law")];
    }
    let inner = |schema: &Value| faults(schema, value, at);
    let number = value.as_f64();
    for (keyword, needed) in schema.as_object().unwrap() {
        let is_fine = match keyword.as_str() {
            "$schema" | "title" | "description" | "default" | "examples" | "additionalProperties" => true,
            "type" => match needed.as_str().unwrap() {
                "number" => value.is_number(),
                "integer" => value.is_u64() || value.is_i64(),
                "string" => value.is_string(),
                "boolean" => value.is_boolean(),
                "array" => value.is_array(),
                "object" => value.is_object(),
                other => panic!("type {other} of {at}"),
            },
            "const" => value == needed,
            "enum" => needed.as_array().unwrap().contains(value),
            "pattern" => {
                let kernels = "^(sobolev-matern-[0-9]+|gaussian|wendland-c2|wendland-c4)$";
                assert_eq!(needed, kernels);
                let word = value.as_str().unwrap_or_default();
                let order = word.strip_prefix("sobolev-matern-").unwrap_or_default();
                let is_order = !order.is_empty() && order.bytes().all(|byte| byte.is_ascii_digit());
                is_order || ["gaussian", "wendland-c2", "wendland-c4"].contains(&word)
            }
            "minimum" => number.is_none_or(|x| x >= needed.as_f64().unwrap()),
            "maximum" => number.is_none_or(|x| x <= needed.as_f64().unwrap()),
            "exclusiveMinimum" => number.is_none_or(|x| x > needed.as_f64().unwrap()),
            "exclusiveMaximum" => number.is_none_or(|x| x < needed.as_f64().unwrap()),
            "multipleOf" => number.is_none_or(|x| x % needed.as_f64().unwrap() == 0.0),
            "minItems" => value.as_array().is_none_or(|items| items.len() as u64 >= needed.as_u64().unwrap()),
            "maxItems" => value.as_array().is_none_or(|items| items.len() as u64 <= needed.as_u64().unwrap()),
            "uniqueItems" => {
                value.as_array().is_none_or(|items| (1..items.len()).all(|i| !items[..i].contains(&items[i])))
            }
            "required" => {
                let keys = needed.as_array().unwrap();
                keys.iter().all(|key| value.get(key.as_str().unwrap()).is_some())
            }
            "items" => {
                for (i, item) in value.as_array().into_iter().flatten().enumerate() {
                    found.extend(faults(needed, item, &format!("{at}[{i}]")));
                }
                true
            }
            "properties" => {
                for (key, value) in value.as_object().into_iter().flatten() {
                    match needed.get(key) {
                        Some(schema) => found.extend(faults(schema, value, &format!("{at}.{key}"))),
                        // An alternative of a table names but the keys on which it depends.
                        None if schema["additionalProperties"] == json!(false) => {
                            found.push(format!("{at}.{key} is unknown"));
                        }
                        None => assert!(schema.get("type").is_none(), "{at}"),
                    }
                }
                true
            }
            "anyOf" => needed.as_array().unwrap().iter().any(|schema| inner(schema).is_empty()),
            "oneOf" => {
                needed.as_array().unwrap().iter().filter(|schema| inner(schema).is_empty()).count() == 1
            }
            other => panic!("keyword {other} of {at} is unknown to this test"),
        };
        if !is_fine {
            found.push(format!("{at}: {value} is not {keyword} {needed}"));
        }
    }
    found
}

fn by_schema(document: &toml::Table) -> Vec<String> {
    faults(&schema(), &serde_json::to_value(document).unwrap(), "")
}

fn by_service(document: &toml::Table) -> Result<(), String> {
    let file =
        ConfigFile::parse("test.toml".into(), document.to_string()).map_err(|error| error.to_string())?;
    assemble::estimator(&file).map(|_| ()).map_err(|error| error.to_string())
}

#[track_caller]
fn assert_taken(document: &toml::Table) {
    assert_eq!(by_schema(document), Vec::<String>::new(), "{document}");
    assert_eq!(by_service(document), Ok(()), "{document}");
}

#[track_caller]
fn assert_refused(document: &toml::Table, part: &str) {
    let (schema, service) = (by_schema(document), by_service(document));
    assert!(!schema.is_empty(), "the schema takes {part}: {document}");
    let message = service.expect_err(&format!("the service takes {part}: {document}"));
    assert!(message.contains(part), "'{part}' is missing in: {message}");
}

fn preset(name: &str) -> toml::Table {
    let (_, text) = PRESETS.iter().find(|(known, _)| *known == name).unwrap();
    text.parse().unwrap()
}

/// A good document that has the table of this key, or may have it: of the law that has the key.
fn document_for(key: &str) -> toml::Table {
    let (table, rest) = key.split_once('.').unwrap_or((key, ""));
    let joint = &schema()["properties"][table]["oneOf"][0]["properties"];
    let is_of_the_gradient_law = joint[rest.split('.').next().unwrap()] == json!(false);
    preset(match table {
        "linear" => "linear",
        _ if is_of_the_gradient_law => "rigid-body-gradient",
        _ => "rigid-body",
    })
}

/// The document with the key `a.b.c` at a value.
fn with(mut document: toml::Table, key: &str, value: &Value) -> toml::Table {
    let mut table = &mut document;
    let (path, name) = key.rsplit_once('.').unwrap_or(("", key));
    for step in path.split('.').filter(|step| !step.is_empty()) {
        // Of several tables, one that is whole.
        let new = match step {
            "sensor" => toml::toml! { sensor = [{ name = "dvl", number = 1 }] }["sensor"].clone(),
            _ => toml::Table::new().into(),
        };
        let value = table.entry(step).or_insert(new);
        table = first_table(value);
    }
    if name.starts_with("centers_listed") {
        table.retain(|other, _| !other.starts_with("centers_"));
    }
    table.insert(name.into(), toml::Value::try_from(value).unwrap());
    document
}

/// A table, or the first of several.
fn first_table(value: &mut toml::Value) -> &mut toml::Table {
    match value {
        toml::Value::Array(tables) => tables[0].as_table_mut().unwrap(),
        value => value.as_table_mut().unwrap(),
    }
}

/// All keys, `table.key`, with their schemas.
fn keys() -> Vec<(String, Value)> {
    fn collect(path: &str, schema: &Value, keys: &mut Vec<(String, Value)>) {
        let alternatives = schema["anyOf"].as_array().into_iter().flatten();
        for schema in [schema, &schema["items"]].into_iter().chain(alternatives) {
            for (name, schema) in schema["properties"].as_object().into_iter().flatten() {
                let key = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                collect(&key, schema, keys);
                keys.push((key, schema.clone()));
            }
        }
    }
    let mut keys_found = Vec::new();
    collect("", &schema(), &mut keys_found);
    assert!(keys_found.len() > 110, "{}", keys_found.len());
    keys_found
}

fn is_table(schema: &Value) -> bool {
    schema["properties"].is_object() || schema["items"]["properties"].is_object()
}

#[test]
fn every_preset_and_what_config_prints_of_it_is_taken() {
    for (name, text) in PRESETS {
        assert_taken(&preset(name));
        let file = ConfigFile::parse(name.into(), text.into()).unwrap();
        let printed = file.commented_toml();
        let again = ConfigFile::parse("printed".into(), printed.clone()).unwrap();
        assert_eq!(again.config, file.config, "{printed}");
        assert_eq!(by_schema(&printed.parse().unwrap()), Vec::<String>::new(), "{printed}");
    }
}

#[test]
fn unknown_keys_and_missing_ones_are_refused_in_every_table() {
    for (key, schema) in keys().into_iter().filter(|(_, schema)| is_table(schema)) {
        let unknown = with(document_for(&key), &format!("{key}.unknown"), &json!(1.0));
        assert_refused(&unknown, "unknown field `unknown`");
        let alternatives = schema["oneOf"].as_array().into_iter().flatten();
        for name in [&schema, &schema["items"]]
            .into_iter()
            .chain(alternatives)
            .flat_map(|schema| schema["required"].as_array().into_iter().flatten())
            .map(|name| name.as_str().unwrap())
            // Without it the law is another, and listed centers stand in no preset.
            .filter(|name| *name != "law" && !name.starts_with("centers_listed"))
        {
            // Some keys one law needs and the other may have.
            let mut document = document_for(&format!("{key}.{name}"));
            if key == "sensor" {
                document = with(document, "sensor.lever_arm_m", &json!([0.1, 0.0, 0.0]));
            } else if document[&key].get(name).is_none() {
                document = preset("rigid-body-gradient");
            }
            first_table(&mut document[&key]).remove(name).unwrap_or_else(|| panic!("{key}.{name}"));
            assert_refused(&document, if name.starts_with("centers_") { "centers_listed_…" } else { name });
        }
    }
    assert_refused(&with(document_for(""), "unknown", &json!(1.0)), "unknown field `unknown`");
    let mut nothing = preset("rigid-body");
    nothing.retain(|key, _| key == "rate_hz");
    assert_refused(&nothing, "neither [translation] nor");
    nothing.remove("rate_hz");
    assert_refused(&nothing, "rate_hz");
}

#[test]
fn keys_of_the_other_law_are_refused() {
    let mut n_refused = 0;
    for (key, schema) in keys() {
        let value = [schema.get("default"), schema["examples"].get(0)].into_iter().flatten().next();
        let ("translation" | "rotation", Some(value)) = (key.split('.').next().unwrap(), value) else {
            continue;
        };
        for name in ["rigid-body", "rigid-body-gradient"] {
            let document = with(preset(name), &key, value);
            let service = by_service(&document);
            assert_eq!(by_schema(&document).is_empty(), service.is_ok(), "{name}, {key}: {service:?}");
            n_refused += usize::from(service.is_err_and(|message| message.contains(".law = ")));
        }
    }
    assert!(n_refused > 40, "{n_refused}");
}

#[test]
fn every_key_is_described_and_its_example_or_default_is_taken() {
    for (key, schema) in keys() {
        let text = schema["description"].as_str().unwrap_or_else(|| panic!("{key} is not described"));
        assert!(text.len() > 8 && text.ends_with('.'), "{key}: {text}");
        if is_table(&schema) {
            continue;
        }
        let values: Vec<_> =
            schema["examples"].as_array().into_iter().flatten().chain(schema.get("default")).collect();
        assert!(!values.is_empty(), "{key} has no example");
        for value in values {
            assert_taken(&with(document_for(&key), &key, value));
        }
    }
}

#[test]
fn every_example_of_the_reference_is_taken() {
    let text = reference::markdown();
    let blocks: Vec<&str> =
        text.split("```toml\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    assert_eq!(blocks.len(), 13);
    for block in blocks {
        let mut document: toml::Table = block.parse().unwrap_or_else(|error| panic!("{error}\n{block}"));
        let has_a_channel =
            ["translation", "rotation", "linear"].iter().any(|name| document.contains_key(*name));
        let nested = ["joint", "solver"].iter().find(|name| block.contains(&format!(".{name}]")));
        if !has_a_channel || nested.is_some() {
            let mut whole = document_for(&format!("translation.{}", nested.unwrap_or(&"")));
            for (key, value) in document {
                match (whole.get_mut(&key).and_then(|table| table.as_table_mut()), value) {
                    (Some(table), toml::Value::Table(value)) => table.extend(value),
                    (_, value) => drop(whole.insert(key, value)),
                }
            }
            document = whole;
        }
        document.entry("rate_hz").or_insert(200.0.into());
        assert_taken(&document);
    }
}

/// The least step beyond a bound that both must see.
#[test]
fn every_bound_is_held() {
    let mut n_bounds = 0;
    for (key, schema) in keys() {
        let is_integer = schema["type"] == "integer";
        let beyond = |keyword: &str| {
            let bound = schema[keyword].as_f64()?;
            let step = if is_integer { 1.0 } else { 1e-9 * bound.abs().max(1.0) };
            Some(match keyword {
                "minimum" => bound - step,
                "maximum" => bound + step,
                _ => bound,
            })
        };
        for keyword in ["minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"] {
            let Some(beyond) = beyond(keyword) else { continue };
            let value = if is_integer { json!(beyond as i64) } else { json!(beyond) };
            // What cannot be negative by its type is refused by its line alone.
            let name = key.rsplit('.').next().unwrap();
            let part = match () {
                () if is_integer && beyond < 0.0 => "invalid value",
                () if key.contains(".solver.") => "solver",
                () if name.starts_with("position_fix") => "position_fix",
                () if name.starts_with("attitude_fix") => "attitude_fix",
                () => name,
            };
            let mut document = document_for(&key);
            if let Some((solver, _)) = key.split_once(".solver.") {
                // Its options are checked where they are used.
                document = with(document, &format!("{solver}.solver.kind"), &json!("local"));
            }
            assert_refused(&with(document, &key, &value), part);
            n_bounds += 1;
        }
    }
    assert!(n_bounds > 60, "{n_bounds}");
}

#[test]
fn values_of_another_type_are_refused() {
    // A sensor may have any name.
    let keys = keys().into_iter().filter(|(key, schema)| !is_table(schema) && key != "sensor.name");
    for (key, schema) in keys {
        for value in [json!({ "x": [] }), json!("no such word"), json!([["x"]])] {
            let document = with(document_for(&key), &key, &value);
            let agreed = by_schema(&document).is_empty() == by_service(&document).is_ok();
            assert!(
                agreed,
                "{key} = {value}: {:?} by the schema, {:?}",
                by_schema(&document),
                by_service(&document)
            );
            assert!(!by_schema(&document).is_empty(), "{key} = {value} is taken: {schema}");
        }
    }
}

/// Defaults: what the service fills in where a document says nothing.
#[test]
fn every_default_is_the_one_in_use() {
    let mut n_defaults = 0;
    for (name, tables) in [("rigid-body", ["translation", "rotation"].as_slice()), ("linear", &["linear"])] {
        let mut least = preset(name);
        for table in tables {
            let schema = schema();
            let schema = &schema["properties"][table];
            let needed = [&schema["required"], &schema["oneOf"][0]["required"]]
                .map(|names| names.as_array().unwrap().clone())
                .concat();
            least[*table].as_table_mut().unwrap().retain(|key, _| needed.iter().any(|needed| needed == key));
            least[*table].as_table_mut().unwrap().insert("solver".into(), toml::Table::new().into());
        }
        let config = ConfigFile::parse("least".into(), least.to_string()).unwrap().config;
        let used = serde_json::to_value(&config).unwrap();
        for (key, schema) in keys().into_iter().filter(|(_, schema)| !is_table(schema)) {
            let table = key.split('.').next().unwrap();
            if ["translation", "rotation", "linear"].contains(&table) && !tables.contains(&table)
                || key.ends_with(".solver")
                || table == "sensor"
            {
                continue;
            }
            let in_use = used.pointer(&format!("/{}", key.replace('.', "/")));
            match schema.get("default") {
                Some(default) => assert_eq!(in_use, Some(default), "{key}"),
                None => assert!(
                    in_use.is_none() || least_has(&least, &key),
                    "{key}: {in_use:?} is said to be absent"
                ),
            }
            n_defaults += usize::from(schema.get("default").is_some());
        }
    }
    assert!(n_defaults > 60, "{n_defaults}");
}

fn least_has(document: &toml::Table, key: &str) -> bool {
    serde_json::to_value(document).unwrap().pointer(&format!("/{}", key.replace('.', "/"))).is_some()
}
