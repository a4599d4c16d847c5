//! Tables with a line of column names. A map, on the command line or as TOML, assigns columns to keys. Columns that have the
//! names of keys, as in the tables that this file writes, need no map.
//!
//! A row is a sample with the fields that have all of their cells filled. An empty cell means: not measured at that time. A
//! field with only some of its cells filled, and one with a value that is not finite, carries no measurement either, since a
//! sample holds whole vectors; both are counted and reported.

use crate::collector::{Collector, parse_ns};
use crate::error::{ImportError, Imported, MapError};
use crate::flight::SkipReason;
use csv::ByteRecord;
use serde::de::{Error as _, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use shared_types::Measurement;
use shared_types::payload::{frame, valid};
use shared_types::table::Field;
use std::collections::BTreeMap;
use std::fmt;
use std::io::Write;
use std::path::Path;

/// Unit of the column `time`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeUnit {
    /// Seconds.
    #[default]
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Nanoseconds.
    Ns,
}

impl TimeUnit {
    fn ns(self) -> i128 {
        match self {
            Self::S => 1_000_000_000,
            Self::Ms => 1_000_000,
            Self::Us => 1_000,
            Self::Ns => 1,
        }
    }
}

/// Axes of the columns `velocity_x` … `velocity_z`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum VelocityAxes {
    /// Inertial axes.
    #[default]
    Inertial,
    /// Body axes.
    Body,
}

const BODY_VELOCITY: [&str; 3] = ["body_velocity_x", "body_velocity_y", "body_velocity_z"];

/// The fields of a measurement that a table may hold: place in the payload's table, and row.
fn fields() -> impl Iterator<Item = (usize, &'static Field)> {
    Measurement::quantities()
        .filter(|(_, field, _)| !field.components.names.is_empty())
        .map(|(place, field, _)| (place, field))
}

/// Which column holds what. All in SI units; a quantity has all of its components or none.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct CsvMap {
    /// Column of the time in seconds; or `time` and `time_unit`.
    pub time_s: Option<String>,
    /// Column of the time, in `time_unit`.
    pub time: Option<String>,
    /// Unit of `time`: "s", "ms", "us" or "ns".
    pub time_unit: Option<TimeUnit>,
    /// "inertial" (the default) or "body".
    pub velocity_frame: Option<VelocityAxes>,
    /// Between two values; ',' by default.
    pub separator: Option<char>,
    /// Columns of the components of quantities, by key: `velocity_x`, …; see [`Field::columns`].
    #[serde(flatten)]
    pub columns: BTreeMap<String, String>,
}

impl<'de> Deserialize<'de> for CsvMap {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(MapVisitor)
    }
}

/// A key of a map, checked while it is read, so that the error for an unknown key names its line.
struct Key(String);

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        let others = ["time_s", "time", "time_unit", "velocity_frame", "separator"].map(String::from);
        let known: Vec<String> =
            others.into_iter().chain(fields().flat_map(|(_, field)| field.columns())).collect();
        match known.contains(&key) {
            true => Ok(Self(key)),
            false => {
                let known = known.join("`, `");
                Err(D::Error::custom(format!("unknown field `{key}`, expected one of `{known}`")))
            }
        }
    }
}

struct MapVisitor;

impl<'de> Visitor<'de> for MapVisitor {
    type Value = CsvMap;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("keys and names of columns")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut pairs: A) -> Result<CsvMap, A::Error> {
        let mut map = CsvMap::default();
        while let Some(Key(key)) = pairs.next_key()? {
            match key.as_str() {
                "time_s" => map.time_s = Some(pairs.next_value()?),
                "time" => map.time = Some(pairs.next_value()?),
                "time_unit" => map.time_unit = Some(pairs.next_value()?),
                "velocity_frame" => map.velocity_frame = Some(pairs.next_value()?),
                "separator" => map.separator = Some(pairs.next_value()?),
                _ => _ = map.columns.insert(key, pairs.next_value()?),
            }
        }
        Ok(map)
    }
}

impl CsvMap {
    /// Reads a map from a TOML file and then from `KEY=COLUMN` pairs, which win.
    ///
    /// # Errors
    /// `Unreadable`, `NotAMap` and `NotAPair`, each with the place; contradictions show when the map is used.
    pub fn read(file: Option<&Path>, pairs: &[String]) -> Result<Self, MapError> {
        let mut table = toml::Table::new();
        if let Some(path) = file {
            let place = path.display().to_string();
            let text = std::fs::read_to_string(path)
                .map_err(|error| MapError::Unreadable(place.clone(), error.to_string()))?;
            let not_a_map =
                |error: toml::de::Error| MapError::NotAMap(format!("map '{place}'"), error.to_string());
            // Once into the map itself, for its errors name the line; once as pairs, to be overridden.
            toml::from_str::<Self>(&text).map_err(not_a_map)?;
            table = toml::from_str(&text).map_err(not_a_map)?;
        }
        for pair in pairs {
            let (key, column) = pair.split_once('=').ok_or_else(|| MapError::NotAPair(pair.clone()))?;
            table.insert(key.trim().into(), toml::Value::String(column.into()));
        }
        table.try_into().map_err(|error: toml::de::Error| {
            MapError::NotAMap("--column".into(), error.to_string().trim().into())
        })
    }

    /// The pairs `KEY=COLUMN` that make this map.
    pub(crate) fn pairs(&self) -> Vec<String> {
        let table = toml::Table::try_from(self).unwrap_or_default();
        table.iter().map(|(key, column)| format!("{key}={}", column.as_str().unwrap_or_default())).collect()
    }

    /// This map, and for what it does not name the columns that bear the keys' own names.
    fn with_own_names(&self, header: &[String]) -> Self {
        let mut map = self.clone();
        let is_there = |name: &str| header.iter().any(|column| column == name);
        if map.time.is_none() && map.time_s.is_none() && is_there("time_s") {
            map.time_s = Some("time_s".into());
        }
        let velocity = ["velocity_x", "velocity_y", "velocity_z"];
        let named = velocity.iter().any(|key| map.columns.contains_key(*key));
        if !named && map.velocity_frame.is_none() && BODY_VELOCITY.iter().any(|name| is_there(name)) {
            map.columns
                .extend(velocity.into_iter().zip(BODY_VELOCITY).map(|(key, name)| (key.into(), name.into())));
            map.velocity_frame = Some(VelocityAxes::Body);
        }
        for key in fields().flat_map(|(_, field)| field.columns()).filter(|key| is_there(key)) {
            map.columns.entry(key.clone()).or_insert(key);
        }
        map
    }

    /// The columns of one field, or none.
    fn columns_of(&self, field: &Field) -> Result<Option<Vec<&str>>, MapError> {
        let (named, lacking): (Vec<_>, Vec<_>) =
            field.columns().into_iter().partition(|key| self.columns.contains_key(key));
        if named.is_empty() {
            return Ok(None);
        }
        if !lacking.is_empty() {
            let quantity = field.quantity.map_or(field.name, |quantity| quantity.key);
            return Err(MapError::Partial { quantity, found: named.join(", "), lacking: lacking.join(", ") });
        }
        Ok(Some(named.iter().map(|key| self.columns[key].as_str()).collect()))
    }

    fn time(&self) -> Result<(&str, i128), MapError> {
        match (&self.time_s, &self.time, self.time_unit) {
            (Some(_), Some(_), _) => Err(MapError::Time("both time_s and time are named")),
            (Some(_), None, Some(_)) => Err(MapError::Time("time_unit is given for time_s, which is in s")),
            (Some(column), None, None) => Ok((column, TimeUnit::S.ns())),
            (None, Some(column), Some(unit)) => Ok((column, unit.ns())),
            (None, Some(_), None) => Err(MapError::Time("time is named without time_unit")),
            (None, None, _) => Err(MapError::Time("no column of the time")),
        }
    }

    fn separator(&self) -> Result<u8, MapError> {
        let separator = self.separator.unwrap_or(',');
        let separates = separator == '\t'
            || (separator.is_ascii() && !separator.is_ascii_alphanumeric() && !separator.is_ascii_control())
                && !"\"+-.".contains(separator);
        if separates { Ok(separator as u8) } else { Err(MapError::Separator(separator)) }
    }
}

/// The names in the first line of a table.
///
/// # Errors
/// The separator cannot separate.
pub(crate) fn column_names(bytes: &[u8], map: &CsvMap) -> Result<Vec<String>, MapError> {
    let mut reader = csv::ReaderBuilder::new().delimiter(map.separator()?).from_reader(bytes);
    let header = reader.byte_headers().cloned().unwrap_or_default();
    Ok(header.iter().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect())
}

/// Where the columns of a file are.
struct Places {
    time: usize,
    ns_per_unit: i128,
    velocity_axes: VelocityAxes,
    /// Of each field that has columns: its place in the payload's table, the key of its quantity, and its columns' places.
    fields: Vec<(usize, &'static str, Vec<usize>)>,
}

/// What a table's cells left out of its samples.
#[derive(Default)]
struct LeftOut {
    /// Values that are given as not finite.
    not_finite: usize,
    /// Fields with a value and an empty cell; quantity and line of the first.
    in_part: usize,
    first_in_part: Option<(&'static str, u64)>,
}

impl LeftOut {
    fn remark(&self) -> Option<String> {
        let (quantity, line) = self.first_in_part?;
        Some(format!(
            "quantities with only some of their cells filled, which carry no measurement: {} (first: {quantity}, line {line})",
            self.in_part
        ))
    }
}

impl Places {
    fn find(map: &CsvMap, header: &ByteRecord, path: &str) -> Imported<Self> {
        let names: Vec<_> =
            header.iter().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect();
        let place_of = |column: &str| {
            names.iter().position(|name| name == column).ok_or_else(|| ImportError::MissingColumn {
                path: path.into(),
                column: column.into(),
                found: names.join(", "),
            })
        };
        let map = &map.with_own_names(&names);
        let (time, ns_per_unit) = map.time()?;
        let mut columns = Vec::new();
        for (place, field) in fields() {
            columns.extend(map.columns_of(field)?.map(|columns| (place, field, columns)));
        }
        let is_rate = |field: &Field| field.valid & (valid::VELOCITY | valid::ANGULAR_VELOCITY) != 0;
        if !columns.iter().any(|(_, field, _)| is_rate(field)) {
            return Err(MapError::NothingMeasured.into());
        }
        let time = place_of(time)?;
        let found = columns.into_iter().map(|(place, field, columns)| {
            let quantity = field.quantity.map_or(field.name, |quantity| quantity.key);
            Ok((place, quantity, columns.into_iter().map(place_of).collect::<Imported<_>>()?))
        });
        let velocity_axes = map.velocity_frame.unwrap_or_default();
        Ok(Self { time, ns_per_unit, velocity_axes, fields: found.collect::<Imported<_>>()? })
    }

    /// Time and sample of the row in this line, with the fields whose cells all have a finite value.
    fn read(
        &self,
        row: &Row<'_>,
        line: u64,
        left_out: &mut LeftOut,
    ) -> Result<(i128, Measurement), SkipReason> {
        let time_ns = parse_ns(row.text(self.time)?, self.ns_per_unit).ok_or(SkipReason::NotANumber)?;
        let mut sample = Measurement::default();
        for (place, quantity, columns) in &self.fields {
            match row.values(columns)? {
                Cells::Values(numbers) => sample.set(*place, &numbers),
                Cells::Empty => {}
                Cells::InPart => {
                    left_out.in_part += 1;
                    left_out.first_in_part.get_or_insert((quantity, line));
                }
                Cells::NotFinite(count) => left_out.not_finite += count,
            }
        }
        if sample.has(valid::VELOCITY) && self.velocity_axes == VelocityAxes::Body {
            sample.velocity_frame = frame::BODY;
        }
        Ok((time_ns, sample))
    }
}

struct Row<'a>(&'a ByteRecord);

impl Row<'_> {
    fn text(&self, place: usize) -> Result<&str, SkipReason> {
        let cell = self.0.get(place).ok_or(SkipReason::TooFewValues)?;
        str::from_utf8(cell).map(str::trim).map_err(|_| SkipReason::NotANumber)
    }

    /// What these columns have.
    fn values(&self, columns: &[usize]) -> Result<Cells, SkipReason> {
        let mut values = Vec::with_capacity(columns.len());
        for &column in columns {
            let text = self.text(column)?;
            if !text.is_empty() {
                values.push(text.parse::<f64>().map_err(|_| SkipReason::NotANumber)?);
            }
        }
        let not_finite = values.iter().filter(|value| !value.is_finite()).count();
        Ok(match (values.len(), not_finite) {
            (0, _) => Cells::Empty,
            (_, 1..) => Cells::NotFinite(not_finite),
            (n, 0) if n < columns.len() => Cells::InPart,
            _ => Cells::Values(values),
        })
    }
}

/// The cells of one field in a row.
enum Cells {
    /// All have a finite value.
    Values(Vec<f64>),
    /// All are empty: the field was not measured then.
    Empty,
    /// Some are empty.
    InPart,
    /// So many values are not finite.
    NotFinite(usize),
}

pub(crate) fn parse(bytes: &[u8], path: &str, map: &CsvMap) -> Imported {
    let mut reader = csv::ReaderBuilder::new().delimiter(map.separator()?).flexible(true).from_reader(bytes);
    let header = match reader.byte_headers() {
        Ok(header) if !header.is_empty() => header.clone(),
        _ => return Err(ImportError::Empty(path.into())),
    };
    let places = Places::find(map, &header, path)?;
    let mut flight = Collector::default();
    let mut left_out = LeftOut::default();
    let mut record = ByteRecord::new();
    // Reading bytes of memory into a flexible record leaves no error but the end.
    while reader.read_byte_record(&mut record).unwrap_or(false) {
        let line = record.position().map_or(0, csv::Position::line);
        match places.read(&Row(&record), line, &mut left_out) {
            Ok((time_ns, sample)) => {
                flight.add(line, time_ns, sample);
            }
            Err(reason) => flight.skipped.add(reason, line),
        }
    }
    flight.values_not_finite = left_out.not_finite;
    flight.remarks.extend(left_out.remark());
    flight.finish(path, None)
}

/// Writes samples as a table that is read without a map: `time_s` with nanoseconds, then the columns of every quantity
/// that any of them has, in SI units, so that they are read as the same numbers; cells without a measurement are empty.
///
/// # Errors
/// What the writer says.
pub fn write_table(out: impl Write, samples: &[Measurement]) -> std::io::Result<()> {
    let any = samples.iter().fold(0, |any, sample| any | sample.valid);
    let is_body = samples.iter().any(|sample| sample.velocity_frame == frame::BODY);
    let written: Vec<_> = fields().filter(|(_, field)| any & field.valid != 0).collect();
    let mut writer = csv::Writer::from_writer(out);
    let names = written.iter().flat_map(|(_, field)| match field.valid {
        valid::VELOCITY if is_body => BODY_VELOCITY.map(String::from).into(),
        _ => field.columns(),
    });
    writer.write_record(std::iter::once("time_s".into()).chain(names))?;
    for sample in samples {
        let ns = sample.stamp_ns;
        let mut row = vec![format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)];
        for (place, field) in &written {
            let number =
                |number: &f64| if sample.has(field.valid) { number.to_string() } else { String::new() };
            row.extend(sample.numbers(*place).iter().map(number));
        }
        writer.write_record(&row)?;
    }
    writer.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(pairs: &[&str]) -> CsvMap {
        CsvMap::read(None, &pairs.iter().map(|pair| (*pair).into()).collect::<Vec<_>>()).unwrap()
    }

    fn velocity_map() -> CsvMap {
        map(&["time_s=t", "velocity_x=vx", "velocity_y=vy", "velocity_z=vz"])
    }

    fn refused(pairs: &[&str]) -> String {
        let map = CsvMap::read(None, &pairs.iter().map(|pair| (*pair).into()).collect::<Vec<_>>());
        match map {
            Ok(map) => parse(b"t,vx,vy,vz\n0,1,2,3\n", "a.csv", &map).unwrap_err().to_string(),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn every_quantity_is_taken_from_its_columns() {
        let names = "stamp;vx;vy;vz;wx;wy;wz;px;py;pz;qw;qx;qy;qz;fx;fy;fz;tx;ty;tz;ax;ay;az;more";
        let mut pairs = vec!["time=stamp".to_owned(), "time_unit=us".into(), "separator=;".into()];
        pairs.push("velocity_frame=body".into());
        for (quantity, letter) in [
            ("velocity", 'v'),
            ("angular_velocity", 'w'),
            ("position", 'p'),
            ("force", 'f'),
            ("torque", 't'),
            ("specific_force", 'a'),
        ] {
            pairs.extend(["x", "y", "z"].map(|axis| format!("{quantity}_{axis}={letter}{axis}")));
        }
        pairs.extend(["w", "x", "y", "z"].map(|axis| format!("attitude_{axis}=q{axis}")));
        let map = CsvMap::read(None, &pairs).unwrap();
        let text = format!(
            "{names}\n1718295482836884;1;2;3;4;5;6;7;8;9;0;0;1;0;10;11;12;13;14;15;16;17;18;x\n\
             1718295482846885;1;2;3;4;5;6;;;;0;0;-1;0;;;;13;14;15;16;17;18;x\n"
        );
        let flight = parse(text.as_bytes(), "a.csv", &map).unwrap();
        let [first, second] = flight.samples[..] else { panic!("two rows") };
        let every = valid::RIGID_BODY | valid::SPECIFIC_FORCE;
        assert_eq!((first.valid, first.velocity_frame), (every, frame::BODY));
        assert_eq!((first.velocity_m_s, first.angular_velocity_rad_s), ([1., 2., 3.], [4., 5., 6.]));
        assert_eq!((first.position_m, first.attitude_wxyz), ([7., 8., 9.], [0., 0., 1., 0.]));
        assert_eq!((first.force_n, first.torque_n_m), ([10., 11., 12.], [13., 14., 15.]));
        assert_eq!(first.specific_force_m_s2, [16., 17., 18.]);
        assert_eq!((second.stamp_ns, second.sequence), (10_001_000, 1));
        assert_eq!(second.valid, every & !valid::POSITION & !valid::FORCE);
        assert_eq!((flight.skipped_rows(), flight.airborne), (0, None));
    }

    #[test]
    fn a_written_table_is_read_as_the_same_samples_without_a_map() {
        let third = |j: u64| [j as f64 / 3.0, -0.1 * j as f64, 1e-300];
        let inertial = |j: u64| {
            let half = std::f64::consts::FRAC_1_SQRT_2;
            let sample = Measurement::at(j * 3_333_333, j).with_velocity_m_s(third(j));
            let sample = sample.with_force_n(third(j + 7)).with_torque_n_m(third(j + 9));
            // Every third one has an attitude and a position.
            match j % 3 {
                0 => sample.with_attitude_wxyz([half, 0.0, -half, 0.0]).with_position_m(third(j + 5)),
                _ => sample,
            }
        };
        let body = |j: u64| {
            let sample = Measurement::at(j * 5_000_000, j).with_angular_velocity_rad_s(third(j));
            if j.is_multiple_of(2) { sample.with_body_velocity_m_s(third(j + 3)) } else { sample }
        };
        for samples in [(0..9).map(inertial).collect::<Vec<_>>(), (0..9).map(body).collect()] {
            let mut table = Vec::new();
            write_table(&mut table, &samples).unwrap();
            assert_eq!(parse(&table, "a.csv", &CsvMap::default()).unwrap().samples, samples);
        }
    }

    #[test]
    fn a_name_that_is_given_wins_over_a_column_that_bears_the_keys_own() {
        let text = b"time_s,velocity_x,velocity_y,velocity_z,vx\n0,1,2,3,7\n";
        let flight = parse(text, "a.csv", &map(&["velocity_x=vx"])).unwrap();
        assert_eq!(flight.samples[0].velocity_m_s, [7.0, 2.0, 3.0]);
        let lacking = parse(b"time_s,velocity_x,velocity_y\n0,1,2\n", "a.csv", &CsvMap::default());
        assert!(lacking.unwrap_err().to_string().contains("lacks velocity_z"));
    }

    #[test]
    fn empty_cells_and_nan_leave_their_field_out_and_words_their_row() {
        let text = "t,vx,vy,vz,wx,wy,wz\n\
                    0,1,2,3,4,5,6\n1,NaN,2,inf,4,5,6\n2,1,,3,4,5,6\n3,,,,,,\n4,word,2,3,4,5,6\n,1,2,3,4,5,6\n4,1\n2,1,2,3,4,5,6\n";
        let rates = ["angular_velocity_x=wx", "angular_velocity_y=wy", "angular_velocity_z=wz"];
        let both = [&["time_s=t", "velocity_x=vx", "velocity_y=vy", "velocity_z=vz"][..], &rates].concat();
        let flight = parse(text.as_bytes(), "a.csv", &map(&both)).unwrap();
        let fields: Vec<_> = flight.samples.iter().map(|sample| sample.valid).collect();
        let all = valid::VELOCITY | valid::ANGULAR_VELOCITY;
        assert_eq!(fields, [all, valid::ANGULAR_VELOCITY, valid::ANGULAR_VELOCITY]);
        assert_eq!(flight.values_not_finite, 2);
        let findings = flight.findings().join("\n");
        let expected = "quantities with only some of their cells filled, which carry no measurement: 1 (first: velocity, line 4)";
        assert!(findings.contains(expected), "{findings}");
        for (reason, rows) in [
            (SkipReason::NothingMeasured, 1),
            (SkipReason::NotANumber, 2),
            (SkipReason::TooFewValues, 1),
            (SkipReason::TimeNotIncreasing, 1),
        ] {
            assert_eq!(flight.skipped.for_reason(reason), rows, "{}", reason.words());
        }
    }

    /// A Doppler log at 10 Hz among commands at 100 Hz.
    #[test]
    fn a_row_without_a_velocity_still_brings_its_command() {
        let rows = (0..20).map(|j| match j % 10 {
            0 => format!("{},1,2,3,{j},0,0\n", 0.01 * j as f64),
            _ => format!("{},,,,{j},0,0\n", 0.01 * j as f64),
        });
        let text = "time_s,velocity_x,velocity_y,velocity_z,force_x,force_y,force_z\n".to_owned()
            + &rows.collect::<String>();
        let flight = parse(text.as_bytes(), "a.csv", &CsvMap::default()).unwrap();
        for (j, sample) in flight.samples.iter().enumerate() {
            let velocity = if j % 10 == 0 { valid::VELOCITY } else { 0 };
            assert_eq!((sample.valid, sample.force_n), (velocity | valid::FORCE, [j as f64, 0.0, 0.0]));
        }
        assert_eq!((flight.samples.len(), flight.findings()), (20, vec![]));
    }

    #[test]
    fn maps_that_cannot_be_used_say_why() {
        let velocity = ["velocity_x=vx", "velocity_y=vy", "velocity_z=vz"];
        let with = |more: &[&'static str]| refused(&[&velocity[..], more].concat());
        for (message, expected) in [
            (refused(&["time_s=t"]), "neither velocity nor angular velocity"),
            (
                refused(&["time_s=t", "velocity_x=vx"]),
                "velocity has velocity_x but lacks velocity_y, velocity_z",
            ),
            (with(&["time_s=t", "attitude_w=q"]), "attitude has attitude_w but lacks attitude_x"),
            (with(&[]), "no column of the time"),
            (with(&["time=t"]), "time is named without time_unit"),
            (with(&["time=t", "time_unit=min"]), "unknown variant `min`"),
            (with(&["time=t", "time_s=t"]), "both time_s and time"),
            (with(&["time_s=t", "speed=v"]), "unknown field `speed`"),
            (with(&["time_s"]), "--column 'time_s': needed: KEY=COLUMN"),
            (with(&["time_s=t", "separator=5"]), "separator '5'"),
            (with(&["time_s=sec"]), "'a.csv' has no column 'sec'; its columns are: t, vx, vy, vz"),
        ] {
            assert!(message.contains(expected), "'{message}' lacks '{expected}'");
        }
    }

    #[test]
    fn a_map_file_is_overridden_by_the_command_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.toml");
        let text = "time_s = \"t\"\nvelocity_x = \"a\"\nvelocity_y = \"vy\"\nvelocity_z = \"vz\"\n";
        std::fs::write(&path, text).unwrap();
        assert_eq!(CsvMap::read(Some(&path), &["velocity_x=vx".into()]).unwrap(), velocity_map());
        std::fs::write(&path, format!("{text}velocity = \"v\"\n")).unwrap();
        let message = CsvMap::read(Some(&path), &[]).unwrap_err().to_string();
        assert!(message.contains("map.toml") && message.contains("line 5"), "{message}");
        let message = CsvMap::read(Some(Path::new("/no/map.toml")), &[]).unwrap_err().to_string();
        assert!(message.contains("cannot read the map '/no/map.toml'"), "{message}");
    }

    #[test]
    fn empty_files_are_refused_with_a_sentence() {
        for text in ["", "\n", "t,vx,vy,vz\n"] {
            let message = parse(text.as_bytes(), "a.csv", &velocity_map()).unwrap_err().to_string();
            assert!(message.contains("'a.csv'"), "{message}");
            assert!(message.contains("is empty") || message.contains("no usable row"), "{message}");
        }
    }
}
