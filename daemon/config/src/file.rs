//! A configuration together with its text: reading, error messages that name the line, printing.

use crate::presets::PRESETS;
use crate::schema;
use crate::service::Config;
use crate::values::LawName;
use std::path::Path;

/// Why a configuration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: {what}")]
pub struct ConfigError {
    /// File and line.
    pub place: String,
    /// What was found, what is needed, what to do.
    pub what: String,
}

/// A configuration with the text it came from, so that messages can name the line.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfigFile {
    /// The values.
    pub config: Config,
    source: Source,
}

#[derive(Debug, Clone, PartialEq)]
struct Source {
    name: String,
    text: String,
}

impl ConfigFile {
    /// A built-in configuration.
    ///
    /// # Errors
    /// An unknown name, with the known ones.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        match PRESETS.iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Self::parse(format!("preset {name}"), (*text).into()),
            None => Err(ConfigError {
                place: "--preset".into(),
                what: format!(
                    "'{name}' is unknown; needed: one of {}",
                    PRESETS.map(|(known, _)| known).join(", ")
                ),
            }),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be read; as [`ConfigFile::parse`].
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let place = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(place, text),
            Err(error) => {
                let what = format!("cannot be read: {error}; print one to start from: daemon config > FILE");
                Err(ConfigError { place, what })
            }
        }
    }

    /// Reads a text; `name` stands for it in messages.
    ///
    /// # Errors
    /// No TOML, an unknown or missing key, a value of the wrong type: with its line.
    pub fn parse(name: String, text: String) -> Result<Self, ConfigError> {
        let source = Source { name, text };
        match toml::from_str(&source.text) {
            Ok(config) => Ok(Self { config, source }),
            Err(error) => Err(ConfigError {
                place: source.place(error.span().map(|span| span.start)),
                what: with_suggestion(error.message()),
            }),
        }
    }

    /// What the configuration is called in messages: its file, or its preset.
    pub fn name(&self) -> &str {
        &self.source.name
    }

    /// A refusal of this key's value, with its line.
    pub fn refusal(&self, key: &str, found: &str, needed: &str) -> ConfigError {
        ConfigError {
            place: self.source.place(self.source.offset_of(key)),
            what: format!("{key}: found {found}; needed: {needed}"),
        }
    }

    /// Whether a key stands in the text.
    pub(crate) fn is_given(&self, key: &str) -> bool {
        self.source.key_offset(key).is_some()
    }

    /// A key that a channel's law needs is not there.
    pub(crate) fn missing(&self, table: &str, key: &str, law: LawName) -> ConfigError {
        let what = with_suggestion(&format!("missing field `{key}`"));
        ConfigError {
            place: self.source.place(self.source.offset_of(table)),
            what: format!("[{table}] with law = \"{}\": {what}", law.name()),
        }
    }

    /// The effective configuration, defaults included, as TOML with a comment on every key.
    pub fn commented_toml(&self) -> String {
        let text = toml::to_string(&self.config).expect("a configuration is a TOML document");
        let comment = |key: &str| match schema::find(&schema::SCHEMA, key).and_then(schema::meaning) {
            Some(meaning) => format!("# {meaning}\n"),
            None => String::new(),
        };
        let mut commented = format!("# Effective configuration of {}.\n", self.source.name);
        let mut table = String::new();
        let foreign = self.config.keys_of_other_laws();
        let is_foreign = |key: &str| foreign.iter().any(|other| other == key);
        for line in text.lines() {
            let header = line.starts_with('[').then(|| line.trim_matches(['[', ']']));
            if header.is_none() && is_foreign(table.trim_end_matches('.'))
                || line.split_once(" = ").is_some_and(|(key, _)| is_foreign(&format!("{table}{key}")))
            {
                continue;
            }
            if let Some(name) = header.filter(|name| is_foreign(name)) {
                table = format!("{name}.");
                continue;
            }
            if let Some(name) = header {
                table = format!("{name}.");
                commented += &comment(name);
            } else if let Some((key, _)) = line.split_once(" = ") {
                commented += &comment(&format!("{table}{key}"));
            }
            commented += line;
            commented.push('\n');
        }
        commented
    }
}

impl Source {
    fn place(&self, offset: Option<usize>) -> String {
        match offset {
            Some(offset) => {
                let line = self.text[..offset.min(self.text.len())].matches('\n').count() + 1;
                format!("{}, line {line}", self.name)
            }
            None => self.name.clone(),
        }
    }

    /// Where `table.key` stands; where it does not, its table.
    fn offset_of(&self, key: &str) -> Option<usize> {
        let outer = key.rsplit_once('.').map(|(outer, _)| outer);
        self.key_offset(key).or_else(|| outer.and_then(|outer| self.offset_of(outer)))
    }

    /// Where `table.key` stands, if it does.
    fn key_offset(&self, key: &str) -> Option<usize> {
        let document = toml::de::DeTable::parse(&self.text).ok()?;
        let mut table = document.get_ref();
        let mut names = key.split('.').peekable();
        while let Some(name) = names.next() {
            let (at, value) = table.get_key_value(name)?;
            // One of several tables is named by its place: `sensor.0.name`.
            let place =
                names.next_if(|place| place.parse::<usize>().is_ok()).and_then(|place| place.parse().ok());
            let (start, value) = match place {
                None => (at.span().start, value),
                Some(place) => {
                    let one: &toml::Spanned<toml::de::DeValue<'_>> =
                        value.get_ref().as_array()?.get::<usize>(place)?;
                    (one.span().start, one)
                }
            };
            if names.peek().is_none() {
                return Some(start);
            }
            table = value.get_ref().as_table()?;
        }
        None
    }
}

/// Adds the most similar accepted key to a message about an unknown one.
fn with_suggestion(message: &str) -> String {
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    match names.split_first() {
        Some((unknown, accepted)) if message.starts_with("unknown field") => {
            let similar = accepted
                .iter()
                .max_by(|a, b| strsim::jaro_winkler(unknown, a).total_cmp(&strsim::jaro_winkler(unknown, b)));
            let similar = similar.filter(|name| strsim::jaro_winkler(unknown, name) > 0.8);
            let hint = similar.map(|name| format!("; did you mean `{name}`? (a name ends in its unit)"));
            message.to_owned() + &hint.unwrap_or_default()
        }
        Some((missing, _)) if message.starts_with("missing field") => {
            let tables = ["", "translation.", "rotation.", "linear.", "sensor."];
            let note =
                tables.iter().find_map(|table| schema::find(&schema::SCHEMA, &format!("{table}{missing}")));
            message.to_owned()
                + &note.and_then(schema::meaning).map(|text| format!(": {text}")).unwrap_or_default()
        }
        _ => message.into(),
    }
}
