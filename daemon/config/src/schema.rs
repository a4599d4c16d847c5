//! The JSON schema of the configuration, made from its types. Editors complete and check keys with it.

use crate::service::Config;
use schemars::generate::SchemaSettings;
use serde_json::Value;
use std::sync::LazyLock;

/// The schema, without references: each key's own is where the key is. Draft 7, which editors of TOML read.
pub static SCHEMA: LazyLock<Value> = LazyLock::new(|| {
    let settings = SchemaSettings::draft07().with(|settings| settings.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<Config>().to_value();
    simplify(&mut schema);
    schema["title"] = "Configuration of the state-estimation service".into();
    schema
});

/// TOML has no null: a key that may be absent is merely not required. And no widths of numbers.
fn simplify(schema: &mut Value) {
    let Some(object) = schema.as_object_mut() else { return };
    object.remove("format");
    object.remove("title");
    if object.get("default").is_some_and(Value::is_null) {
        object.remove("default");
    }
    if let Some(Value::Array(types)) = object.get_mut("type") {
        types.retain(|name| name != "null");
        if let [only] = types.as_slice() {
            object["type"] = only.clone();
        }
    }
    if let Some(Value::Array(alternatives)) = object.get_mut("anyOf") {
        alternatives.retain(|alternative| alternative["type"] != "null");
        if let [Value::Object(only)] = alternatives.as_slice() {
            let only = only.clone();
            object.remove("anyOf");
            for (key, value) in only {
                object.entry(key).or_insert(value);
            }
        }
    }
    for key in ["anyOf", "oneOf", "items"] {
        match object.get_mut(key) {
            Some(Value::Array(inner)) => inner.iter_mut().for_each(simplify),
            Some(inner) => simplify(inner),
            None => {}
        }
    }
    if let Some(Value::Object(properties)) = object.get_mut("properties") {
        properties.values_mut().for_each(simplify);
    }
}

/// The schema of a key, `table.key` from the root.
pub fn find<'a>(schema: &'a Value, key: &str) -> Option<&'a Value> {
    key.split('.').try_fold(schema, |schema, name| table(schema)?["properties"].get(name))
}

/// The part of a schema that is a table, or of several: a key may take something else too.
pub fn table(schema: &Value) -> Option<&Value> {
    let alternatives = schema["anyOf"].as_array().into_iter().flatten();
    [schema, &schema["items"]].into_iter().chain(alternatives).find(|schema| schema["properties"].is_object())
}

/// What a key means, in a line: the first paragraph of its documentation.
pub fn meaning(schema: &Value) -> Option<String> {
    let text = schema["description"].as_str()?;
    let first = text.split("\n\n").next().unwrap_or(text);
    Some(first.replace('\n', " "))
}

/// A table's keys with their schemas.
pub fn properties(schema: &Value) -> impl Iterator<Item = (&str, &Value)> + Clone {
    let table = table(schema).and_then(|table| table["properties"].as_object());
    table.into_iter().flatten().map(|(name, schema)| (name.as_str(), schema))
}
