//! The specification of faults, on the command line as `KIND@START:LENGTH,key=value,…` and in a file.

use crate::sensors::{Schedule, SensorSuite, Span};
use crate::simulation::SimulationOptions;
use serde::Deserialize;
use shared_types::Measurement;
use shared_types::payload::valid;
use shared_types::table::Field as TableField;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// What goes wrong. A `size` is the norm of the error, in the unit of its field: m/s, rad/s, m, or rad of a rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Each sample is lost with this probability, 0 … 1.
    Drop {
        /// 0 … 1.
        probability: f64,
    },
    /// Every sample is lost.
    Burst,
    /// The sensor repeats its last value, bit for bit.
    Freeze,
    /// One sample in `every` has an error of this size, each in a direction of its own.
    Spike {
        /// Norm of the error, in the field's unit.
        size: f64,
        /// At least 1: every sample.
        every: u64,
    },
    /// One sample in `every` is not a number.
    Nan {
        /// At least 1: every sample.
        every: u64,
    },
    /// A constant error of this size.
    Bias {
        /// Norm of the error, in the field's unit.
        size: f64,
    },
    /// An error that grows from zero.
    Drift {
        /// Norm of the error after 1 s, in the field's unit.
        per_s: f64,
    },
    /// Samples arrive later, in their order: after the fault's end, the next ones queue behind the last delayed one.
    Delay {
        /// By how much (s).
        by_s: f64,
    },
    /// One sample in `every` changes places with the next one.
    Reorder {
        /// At least 2: all samples, in pairs.
        every: u64,
    },
    /// One sample in `every` is sent twice.
    Duplicate {
        /// At least 1: every sample.
        every: u64,
    },
    /// The source's clock is wrong: stamps lie ahead of the truth, or behind.
    ClockJump {
        /// By how much (s); ahead where positive.
        by_s: f64,
    },
    /// Only one sample in `divide_by` is taken.
    RateChange {
        /// At least 2.
        divide_by: u64,
    },
    /// The publishing process is stopped by SIGSTOP, and then goes on.
    Stop,
    /// The publishing process is killed by SIGKILL, and then started again. The vehicle flies on.
    Kill,
    /// The service's process is stopped by SIGSTOP, and then goes on.
    ServiceStop,
    /// The service's process is killed by SIGKILL, and then started again.
    ServiceKill,
}

/// Which part of a sample: all that is measured, or one field of the table of [`Measurement`]; commands are not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Bits of [`valid`].
    pub(super) bits: u32,
}

impl Field {
    /// Velocity.
    pub const VELOCITY: Self = Self { bits: valid::VELOCITY };
    /// All that is measured.
    pub const ALL: Self = Self { bits: u32::MAX };

    /// The fields that a fault may concern, each with its place in the table: readings along axes, and attitudes.
    pub(super) fn places() -> impl Iterator<Item = (usize, &'static TableField, &'static str)> {
        let of_sensors = Measurement::quantities()
            .filter(|(_, field, quantity)| quantity.is_measured && !field.components.names.is_empty());
        of_sensors.map(|(place, field, quantity)| (place, field, quantity.key))
    }

    /// Every name in a specification.
    fn named() -> impl Iterator<Item = (String, Self)> {
        let fields =
            Self::places().map(|(_, field, key)| (key.replace('_', "-"), Self { bits: field.valid }));
        std::iter::once(("all".into(), Self::ALL)).chain(fields)
    }

    /// The name in a specification.
    pub fn name(self) -> String {
        Self::named().find(|(_, field)| *field == self).map_or_else(String::new, |(name, _)| name)
    }

    /// Whether samples of these sensors ever carry it, again and again.
    fn is_measured(self, sensors: &SensorSuite, fixes: bool) -> bool {
        match self.bits {
            valid::VELOCITY => sensors.velocity.exists(),
            valid::ANGULAR_VELOCITY => sensors.angular_velocity.exists(),
            valid::POSITION => {
                fixes || !matches!(sensors.position.schedule, Schedule::Never | Schedule::Start)
            }
            valid::ATTITUDE => sensors.attitude.exists(),
            _ => self == Self::ALL,
        }
    }
}

/// One fault: what, of which field, when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// What goes wrong.
    pub kind: Kind,
    /// Of which field; `ALL` where whole samples or a process are concerned.
    pub field: Field,
    /// When, after the start of the run.
    pub span: Span,
}

/// What a fault acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// Samples are changed.
    Samples,
    /// The publishing process is stopped or killed.
    Source,
    /// The service's process is stopped or killed.
    Service,
}

/// Name, an example, and what it does; in the order of the help.
const KINDS: [(&str, &str, &str); 16] = [
    ("drop", "drop@5:2,probability=0.3", "samples are lost with this probability (0 … 1)"),
    ("burst", "burst@5:0.5", "all samples are lost"),
    ("rate-change", "rate-change@5:2,divide_by=4", "only one sample in divide_by is taken"),
    ("freeze", "freeze@5:1,field=velocity", "the sensor repeats its last value"),
    ("spike", "spike@5:2,size=3,every=10", "one sample in every [10] has an error of this size"),
    ("nan", "nan@5:0.5,field=attitude", "one sample in every [1] is not a number"),
    ("bias", "bias@5:1,size=0.5", "a constant error of this size"),
    ("drift", "drift@5:2,per_s=0.3", "an error that grows by per_s every second"),
    ("delay", "delay@5:1,by_s=0.1", "samples arrive later by this (s), with true stamps"),
    ("reorder", "reorder@5:1,every=4", "one sample in every [2] changes places with the next one"),
    ("duplicate", "duplicate@5:1", "one sample in every [1] is sent twice"),
    ("clock-jump", "clock-jump@5:1,by_s=-2", "stamps lie ahead of the truth by this (s), or behind"),
    ("stop", "stop@5:1", "the publishing process is stopped (SIGSTOP), then goes on"),
    ("kill", "kill@5:1", "the publishing process is killed (SIGKILL), started again"),
    ("service-stop", "service-stop@5:1", "the service's process is stopped, then goes on (bench demo)"),
    ("service-kill", "service-kill@5:1", "the service's process is killed, then started again (bench demo)"),
];

/// What `--help` says about faults.
pub fn help() -> String {
    let mut text = String::from(
        "Faults: KIND@START:LENGTH[,field=FIELD][,key=value …], times in s after the\n\
         start; several with ';' or the option again; or a TOML file of tables\n\
         [[fault]] with the keys kind, start_s, length_s and those below:\n",
    );
    for (_, example, does) in KINDS {
        text.push_str(&format!("  {example}\n      {does}\n"));
    }
    let fields: Vec<_> = Field::named().map(|(name, _)| name).collect();
    text.push_str(&format!("FIELD: {}\n", fields.join(", ")));
    text.push_str(
        "[default: all; of spike, bias and drift: velocity]. size and per_s are norms in\n\
         the field's unit, m/s, rad/s, m or rad (per second); numbers in [] are defaults.",
    );
    text
}

/// Why a fault is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FaultError {
    /// It is written wrongly.
    #[error("fault '{fault}': {found}; needed: {needed}; for example: {example}")]
    Wrong {
        /// The fault as it was written.
        fault: String,
        /// What was found.
        found: String,
        /// What would be accepted.
        needed: String,
        /// A right one.
        example: String,
    },
    /// The file of faults cannot be read.
    #[error(
        "faults from '{file}': {found}; needed: tables like\n[[fault]]\nkind = \"spike\"\nstart_s = 5.0\nlength_s = 2.0\nsize = 3.0"
    )]
    File {
        /// Its path.
        file: String,
        /// What was found.
        found: String,
    },
}

#[derive(Debug, Clone, PartialEq)]
enum Value {
    Number(f64),
    Word(String),
}

/// A fault as it was written: its text, and what is still to be understood of it.
struct Written {
    text: String,
    example: &'static str,
    keys: BTreeMap<String, Value>,
}

const GENERAL: &str = "KIND@START:LENGTH,key=value,…";

impl Written {
    fn wrong(&self, found: impl Into<String>, needed: impl Into<String>) -> FaultError {
        let (fault, example) = (self.text.clone(), self.example.to_owned());
        FaultError::Wrong { fault, found: found.into(), needed: needed.into(), example }
    }

    fn word(&mut self, key: &str) -> Result<Option<String>, FaultError> {
        match self.keys.remove(key) {
            None => Ok(None),
            Some(Value::Word(word)) => Ok(Some(word)),
            Some(Value::Number(number)) => Err(self.wrong(format!("{key} is {number}"), "a word")),
        }
    }

    fn number(
        &mut self,
        key: &str,
        default: Option<f64>,
        accepted: impl Fn(f64) -> bool,
        needed: &str,
    ) -> Result<f64, FaultError> {
        let needed = format!("{key}, {needed}");
        match (self.keys.remove(key), default) {
            (Some(Value::Number(number)), _) if number.is_finite() && accepted(number) => Ok(number),
            (Some(Value::Number(number)), _) => Err(self.wrong(format!("{key} is {number}"), needed)),
            (Some(Value::Word(word)), _) => Err(self.wrong(format!("{key} is '{word}'"), needed)),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(self.wrong(format!("no {key}"), needed)),
        }
    }

    fn size(&mut self, key: &str, needed: &str) -> Result<f64, FaultError> {
        self.number(key, None, |size| size > 0.0, needed)
    }

    /// "One in n".
    fn count(&mut self, key: &str, default: Option<u64>, least: u64) -> Result<u64, FaultError> {
        let needed = format!("a whole number from {least} to 1000000");
        let accepted = |n: f64| n.fract() == 0.0 && (least as f64..=1e6).contains(&n);
        Ok(self.number(key, default.map(|n| n as f64), accepted, &needed)? as u64)
    }

    fn fault(mut self) -> Result<Fault, FaultError> {
        let name = self.word("kind")?.unwrap_or_default();
        let Some((_, example, _)) = KINDS.into_iter().find(|(known, ..)| *known == name) else {
            let names = KINDS.map(|(name, ..)| name);
            return Err(self.wrong(format!("kind '{name}'"), format!("one of {}", names.join(", "))));
        };
        self.example = example;
        const MAX_S: f64 = 1e6;
        let start_s =
            self.number("start_s", None, |s| (0.0..=MAX_S).contains(&s), "the start in s, from 0")?;
        let length_s =
            self.number("length_s", None, |s| s > 0.0 && s <= MAX_S, "the length in s, above 0")?;
        const UNIT: &str = "in the field's unit, above 0";
        let kind = match name.as_str() {
            "drop" => {
                let accepted = |p| (0.0..=1.0).contains(&p);
                Kind::Drop { probability: self.number("probability", None, accepted, "from 0 to 1")? }
            }
            "burst" => Kind::Burst,
            "rate-change" => Kind::RateChange { divide_by: self.count("divide_by", None, 2)? },
            "freeze" => Kind::Freeze,
            "spike" => {
                Kind::Spike { size: self.size("size", UNIT)?, every: self.count("every", Some(10), 1)? }
            }
            "nan" => Kind::Nan { every: self.count("every", Some(1), 1)? },
            "bias" => Kind::Bias { size: self.size("size", UNIT)? },
            "drift" => Kind::Drift { per_s: self.size("per_s", UNIT)? },
            "delay" => Kind::Delay {
                by_s: self.number("by_s", None, |s| s > 0.0 && s <= 60.0, "in s, above 0, at most 60")?,
            },
            "reorder" => Kind::Reorder { every: self.count("every", Some(2), 2)? },
            "duplicate" => Kind::Duplicate { every: self.count("every", Some(1), 1)? },
            "clock-jump" => Kind::ClockJump {
                by_s: self.number(
                    "by_s",
                    None,
                    |s| s != 0.0 && s.abs() <= 1e9,
                    "in s, not 0, ahead where positive",
                )?,
            },
            "stop" => Kind::Stop,
            "kill" => Kind::Kill,
            "service-stop" => Kind::ServiceStop,
            _ => Kind::ServiceKill,
        };
        let field = match self.word("field")? {
            None => kind.default_field(),
            Some(word) if kind.concerns_fields() => {
                let found = Field::named().find(|(name, _)| *name == word);
                let names = || Field::named().map(|(name, _)| name).collect::<Vec<_>>().join(", ");
                found.ok_or_else(|| self.wrong(format!("field '{word}'"), format!("one of {}", names())))?.1
            }
            Some(word) => {
                let needed = format!("no field: {name} concerns whole samples, or a process");
                return Err(self.wrong(format!("field '{word}'"), needed));
            }
        };
        if let Some(key) = self.keys.keys().next() {
            return Err(self.wrong(format!("key '{key}'"), format!("only the keys of {name}")));
        }
        Ok(Fault { kind, field, span: Span { start_s, length_s } })
    }
}

impl Kind {
    /// The name in a specification.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Drop { .. } => "drop",
            Self::Burst => "burst",
            Self::Freeze => "freeze",
            Self::Spike { .. } => "spike",
            Self::Nan { .. } => "nan",
            Self::Bias { .. } => "bias",
            Self::Drift { .. } => "drift",
            Self::Delay { .. } => "delay",
            Self::Reorder { .. } => "reorder",
            Self::Duplicate { .. } => "duplicate",
            Self::ClockJump { .. } => "clock-jump",
            Self::RateChange { .. } => "rate-change",
            Self::Stop => "stop",
            Self::Kill => "kill",
            Self::ServiceStop => "service-stop",
            Self::ServiceKill => "service-kill",
        }
    }

    /// What it acts on.
    pub fn reach(&self) -> Reach {
        match self {
            Self::Stop | Self::Kill => Reach::Source,
            Self::ServiceStop | Self::ServiceKill => Reach::Service,
            _ => Reach::Samples,
        }
    }

    fn has_size(&self) -> bool {
        matches!(self, Self::Spike { .. } | Self::Bias { .. } | Self::Drift { .. })
    }

    fn concerns_fields(&self) -> bool {
        let loses = matches!(self, Self::Drop { .. } | Self::Burst | Self::RateChange { .. });
        loses || self.has_size() || matches!(self, Self::Freeze | Self::Nan { .. })
    }

    fn default_field(&self) -> Field {
        if self.has_size() { Field::VELOCITY } else { Field::ALL }
    }
}

/// As it is written on the command line, with everything that is not default.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{}:{}", self.kind.name(), self.span.start_s, self.span.length_s)?;
        if self.field != self.kind.default_field() {
            write!(f, ",field={}", self.field.name())?;
        }
        match self.kind {
            Kind::Drop { probability } => write!(f, ",probability={probability}"),
            Kind::Spike { size, every } => write!(f, ",size={size},every={every}"),
            Kind::Bias { size } => write!(f, ",size={size}"),
            Kind::Drift { per_s } => write!(f, ",per_s={per_s}"),
            Kind::Delay { by_s } | Kind::ClockJump { by_s } => write!(f, ",by_s={by_s}"),
            Kind::Nan { every: 1 } | Kind::Duplicate { every: 1 } | Kind::Reorder { every: 2 } => Ok(()),
            Kind::Nan { every } | Kind::Duplicate { every } | Kind::Reorder { every } => {
                write!(f, ",every={every}")
            }
            Kind::RateChange { divide_by } => write!(f, ",divide_by={divide_by}"),
            Kind::Burst | Kind::Freeze | Kind::Stop | Kind::Kill | Kind::ServiceStop | Kind::ServiceKill => {
                Ok(())
            }
        }
    }
}

/// The faults of all `--faults` options: each a file that exists, or faults separated by `;`.
///
/// # Errors
/// What is wrong with the first wrong one, and what would be accepted.
pub fn read_faults(arguments: &[String]) -> Result<Vec<Fault>, FaultError> {
    let mut faults = Vec::new();
    for argument in arguments {
        if Path::new(argument).is_file() {
            faults.extend(from_file(argument)?);
        } else {
            let mut texts = argument.split(';').map(str::trim).filter(|text| !text.is_empty()).peekable();
            if texts.peek().is_none() {
                // A run without any fault was hardly meant: an empty variable, say.
                from_text("")?;
            }
            faults.extend(texts.map(from_text).collect::<Result<Vec<_>, _>>()?);
        }
    }
    Ok(faults)
}

fn from_text(text: &str) -> Result<Fault, FaultError> {
    let mut written = Written { text: text.to_owned(), example: KINDS[4].1, keys: BTreeMap::new() };
    let mut parts = text.split(',').map(str::trim);
    let head = parts.next().unwrap_or("");
    let Some((kind, times)) = head.split_once('@') else {
        let found = if text.contains('/') || text.ends_with(".toml") { "no such file" } else { "no '@'" };
        return Err(written.wrong(found, format!("{GENERAL}, or a TOML file")));
    };
    let Some((start, length)) = times.split_once(':') else {
        return Err(written.wrong(format!("times '{times}'"), format!("START:LENGTH in s, as in {GENERAL}")));
    };
    let value = |text: &str| match text.trim().parse::<f64>() {
        Ok(number) => Value::Number(number),
        Err(_) => Value::Word(text.trim().to_owned()),
    };
    written.keys.insert("kind".into(), Value::Word(kind.trim().to_owned()));
    written.keys.insert("start_s".into(), value(start));
    written.keys.insert("length_s".into(), value(length));
    for part in parts {
        let Some((key, given)) = part.split_once('=') else {
            return Err(written.wrong(format!("'{part}'"), "key=value"));
        };
        if written.keys.insert(key.trim().to_owned(), value(given)).is_some() {
            return Err(written.wrong(format!("{} twice", key.trim()), "each key once"));
        }
    }
    written.fault()
}

fn from_file(file: &str) -> Result<Vec<Fault>, FaultError> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Tables {
        fault: Vec<toml::Table>,
    }
    let refused = |found: String| FaultError::File { file: file.to_owned(), found };
    let text = std::fs::read_to_string(file).map_err(|error| refused(error.to_string()))?;
    let tables: Tables = toml::from_str(&text).map_err(|error| refused(error.to_string()))?;
    let fault = |(i, table): (usize, toml::Table)| {
        let text = format!("{file}, [[fault]] number {}", i + 1);
        let mut written = Written { text, example: KINDS[4].1, keys: BTreeMap::new() };
        for (key, value) in table {
            let value = match value {
                toml::Value::Integer(number) => Value::Number(number as f64),
                toml::Value::Float(number) => Value::Number(number),
                toml::Value::String(word) => Value::Word(word),
                other => return Err(written.wrong(format!("{key} = {other}"), "a number or a word")),
            };
            written.keys.insert(key, value);
        }
        written.fault()
    };
    tables.fault.into_iter().enumerate().map(fault).collect()
}

/// Whether a run with these options can have these faults.
///
/// # Errors
/// The first that starts after the end, concerns what is not measured, or stops a process that does not run.
pub fn check_faults(faults: &[Fault], options: &SimulationOptions) -> Result<(), FaultError> {
    let sensors = options.scenario.definition().sensors;
    let wrong = |fault: &Fault, found: String, needed: &str| {
        let (fault, needed) = (fault.to_string(), needed.to_owned());
        Err(FaultError::Wrong { fault, found, needed, example: "burst@2:0.5".into() })
    };
    for (i, fault) in faults.iter().enumerate() {
        if options.duration_s.is_some_and(|duration_s| fault.span.start_s >= duration_s) {
            let found = format!("it starts after the end of {} s", options.duration_s.unwrap_or(0.0));
            return wrong(fault, found, "a start within the run, or a longer --duration");
        }
        if !fault.field.is_measured(&sensors, options.position_fix_hz.is_some()) {
            let (scenario, field) = (options.scenario.name(), fault.field.name());
            let found = format!("scenario '{scenario}' does not measure {field} again and again");
            let needed = match fault.field.bits {
                valid::POSITION => "--position-fix-hz, or another field",
                _ => "another field, or another --scenario",
            };
            return wrong(fault, found, needed);
        }
        let reach = fault.kind.reach();
        let clash = faults[..i].iter().find(|other| {
            reach != Reach::Samples && other.kind.reach() == reach && other.span.overlaps(&fault.span)
        });
        if let Some(other) = clash {
            return wrong(fault, format!("it overlaps {other}"), "one at a time for each process");
        }
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::Scenario;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<Vec<Fault>, FaultError> {
        read_faults(&[text.to_owned()])
    }

    /// Any fault that can be written.
    pub(in super::super) fn any_fault() -> impl Strategy<Value = Fault> {
        let kind = (0..KINDS.len(), 0.0..=1.0f64, 1e-3..100.0f64, 2..50u64).prop_map(
            |(which, probability, size, every)| match KINDS[which].0 {
                "drop" => Kind::Drop { probability },
                "burst" => Kind::Burst,
                "freeze" => Kind::Freeze,
                "spike" => Kind::Spike { size, every },
                "nan" => Kind::Nan { every: every - 1 },
                "bias" => Kind::Bias { size },
                "drift" => Kind::Drift { per_s: size },
                "delay" => Kind::Delay { by_s: size / 100.0 },
                "reorder" => Kind::Reorder { every },
                "duplicate" => Kind::Duplicate { every: every - 1 },
                "clock-jump" => Kind::ClockJump { by_s: size - 50.0 },
                "rate-change" => Kind::RateChange { divide_by: every },
                "stop" => Kind::Stop,
                "kill" => Kind::Kill,
                "service-stop" => Kind::ServiceStop,
                _ => Kind::ServiceKill,
            },
        );
        (kind, 0..Field::named().count(), 0.0..4.0f64, 0.01..2.0f64).prop_map(
            |(kind, field, start_s, length_s)| Fault {
                field: if kind.concerns_fields() { Field::named().nth(field).unwrap().1 } else { Field::ALL },
                kind,
                span: Span { start_s, length_s },
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn what_is_written_is_read_again(faults in prop::collection::vec(any_fault(), 1..5)) {
            let text: Vec<String> = faults.iter().map(Fault::to_string).collect();
            prop_assert_eq!(read(&text.join("; ")).unwrap(), faults);
        }

        #[test]
        fn no_text_is_too_strange_to_be_refused_in_words(text in "[a-z@:;,=0-9.\\- /]{0,40}") {
            if let Err(error) = read(&text) {
                prop_assert!(error.to_string().contains("needed: "));
            }
        }
    }

    #[test]
    fn every_example_of_the_help_is_a_fault_of_its_kind() {
        for (name, example, _) in KINDS {
            let faults = read(example).unwrap();
            assert_eq!((faults.len(), faults[0].kind.name()), (1, name));
            assert!(help().contains(example));
        }
    }

    #[test]
    fn a_file_says_the_same_as_the_command_line() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let text = "[[fault]]\nkind = \"spike\"\nstart_s = 5\nlength_s = 2.0\nsize = 3.0\nevery = 4\n\
             [[fault]]\nkind = \"burst\"\nstart_s = 8\nlength_s = 0.5\nfield = \"velocity\"\n";
        std::fs::write(file.path(), text).unwrap();
        let from_file = read(file.path().to_str().unwrap()).unwrap();
        assert_eq!(from_file, read("spike@5:2,size=3,every=4; burst@8:.5,field=velocity").unwrap());
        for (text, expected) in [
            ("fault = 3", "invalid type"),
            ("[[fault]]\nkind = \"burst\"\n", "number 1': no start_s"),
            ("[[faults]]\nkind = \"burst\"\n", "unknown field"),
            ("[[fault]]\nkind = [1]\n", "kind = [1]"),
        ] {
            std::fs::write(file.path(), text).unwrap();
            let message = read(file.path().to_str().unwrap()).unwrap_err().to_string();
            assert!(message.contains(expected) && message.contains("needed: "), "{message}");
        }
    }

    #[test]
    fn a_wrong_fault_is_refused_with_what_was_found_and_an_example() {
        for (text, expected) in [
            ("spike", "no '@'; needed: KIND@START:LENGTH"),
            ("faults.toml", "no such file"),
            ("spike@5", "times '5'"),
            ("spiek@5:1", "kind 'spiek'; needed: one of drop"),
            (" ; ", "no '@'"),
            (
                "spike@5:1",
                "no size; needed: size, in the field's unit, above 0; for example: spike@5:2,size=3",
            ),
            ("spike@5:1,size=-1", "size is -1"),
            ("spike@5:1,size=big", "size is 'big'"),
            ("spike@5:1,size=1,size=2", "size twice"),
            ("spike@5:1,size=1,evry=2", "key 'evry'; needed: only the keys of spike"),
            ("spike@5:1,size=1,every=1.5", "a whole number from 1"),
            ("spike@5:1,size=1,field=speed", "field 'speed'; needed: one of all, velocity"),
            ("burst@-1:1", "start_s is -1"),
            ("burst@1:0", "length_s is 0"),
            ("burst@1:NaN", "length_s is NaN"),
            ("drop@1:1,probability=2", "from 0 to 1"),
            ("delay@1:1,field=velocity,by_s=1", "no field: delay concerns whole samples"),
            ("rate-change@1:1,divide_by=1", "a whole number from 2"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
            assert!(message.contains("for example: "), "{message}");
        }
    }

    #[test]
    fn faults_must_fit_the_run() {
        let options =
            SimulationOptions { duration_s: Some(10.0), ..SimulationOptions::of(Scenario::Rotation) };
        for (text, expected) in [
            ("burst@10:1", "starts after the end of 10 s"),
            ("bias@1:1,size=1", "'rotation' does not measure velocity"),
            (
                "nan@1:1,field=position",
                "does not measure position again and again; needed: --position-fix-hz",
            ),
            ("stop@1:2;kill@2:1", "it overlaps stop@1:2"),
        ] {
            let message = check_faults(&read(text).unwrap(), &options).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        let fitting = "burst@9:5;bias@1:1,size=1,field=attitude;stop@1:2;kill@3:1;burst@1:1;service-stop@1:1";
        check_faults(&read(fitting).unwrap(), &options).unwrap();
        let fixes =
            SimulationOptions { position_fix_hz: Some(1.0), ..SimulationOptions::of(Scenario::RigidBody) };
        check_faults(&read("nan@1:1,field=position").unwrap(), &fixes).unwrap();
    }
}
