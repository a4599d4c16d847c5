//! Reads MCAP files: the measurements of `monitor record`, to the bit, except those that the service's gate rejects for
//! their values; and other channels, if the map of columns names them as `KEY=/topic:path.to.field`.
//!
//! Messages are read by the names in the file's own schema, so fields of a recording of another version are read if their
//! names are the same. A file without an end, of a recorder that was killed, is read as far as it goes.

use crate::collector::Collector;
use crate::error::{ImportError, Imported};
use crate::flight::SkipReason;
use crate::importer::ImportOptions;
use crate::table::{self, CsvMap, TimeUnit};
use mcap::read::ChannelAccumulator;
use mcap::records::{MessageHeader, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Channel, McapError, Message, parse_record};
use prost_reflect::prost::Message as _;
use prost_reflect::prost_types::{FileDescriptorProto, FileDescriptorSet};
use prost_reflect::{DescriptorPool, DynamicMessage, MessageDescriptor, ReflectMessage, Value};
use shared_types::Measurement;
use shared_types::payload::MAX_SEQUENCE_GAP;
use std::collections::{BTreeMap, BTreeSet};

/// The schema that `monitor record` gives to measurements.
const SCHEMA: &str = "measurement.Measurement";
/// A record may be longer than the file that holds it, compressed; but not than this (bytes).
const MAX_RECORD_BYTES: usize = 1 << 26;

/// The flight of the columns that the map names, else the measurements of `topic`, or of the only one.
///
/// # Errors
/// `Content` where the file is none, or has no such topic or field; `Map`; `Option`; `NoUsableRow`.
pub(super) fn parse(bytes: &[u8], name: &str, options: &ImportOptions) -> Imported {
    let ImportOptions { columns, topic, .. } = options;
    match *columns == CsvMap::default() {
        true => recording(bytes, name, topic.as_deref()),
        false if topic.is_none() => channels(bytes, name, columns),
        false => Err(ImportError::Option(
            "--topic and columns: needed: one of them; a column's topic is in --column KEY=/topic:path"
                .into(),
        )),
    }
}

fn wrong(name: &str, found: String) -> ImportError {
    ImportError::Content(name.into(), found)
}

/// Gives each message and its number to `take`; returns where and why the file ends early, if it does.
fn each(
    bytes: &[u8],
    name: &str,
    mut take: impl FnMut(u64, &Message<'_>),
) -> Imported<Option<(u64, String)>> {
    // Without a limit and a look at the check sums first, lengths of garbage overflow in the reader (mcap 0.26.0).
    let options = LinearReaderOptions::default()
        .with_record_length_limit(bytes.len().max(MAX_RECORD_BYTES))
        .with_prevalidate_chunk_crcs(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut channels = ChannelAccumulator::default();
    let (mut rest, mut line, mut is_summary) = (bytes, 0, false);
    // After an error nothing can be found any more; the part before it is good.
    let ends = |line: u64, error: &McapError| match (error, line) {
        (McapError::BadMagic, 0) => Err(wrong(name, told(error))),
        _ => Ok(Some((line + 1, told(error)))),
    };
    while let Some(event) = reader.next_event() {
        let record = match event {
            Ok(LinearReadEvent::ReadRequest(needed)) => {
                let (next, after) = rest.split_at(needed.min(rest.len()));
                reader.insert(next.len()).copy_from_slice(next);
                reader.notify_read(next.len());
                rest = after;
                continue;
            }
            Ok(LinearReadEvent::Record { opcode, data }) => parse_record(opcode, data),
            Err(error) => return ends(line, &error),
        };
        let noted = match record {
            // The summary repeats the contents.
            Ok(_) if is_summary => Ok(()),
            Ok(Record::Schema { header, data }) => channels.add_schema(header, data.into_owned().into()),
            Ok(Record::Channel(channel)) => channels.add_channel(channel),
            Ok(Record::Message { header, data }) => match channels.get(header.channel_id) {
                Some(channel) => {
                    line += 1;
                    let MessageHeader { sequence, log_time, publish_time, .. } = header;
                    take(line, &Message { channel, sequence, log_time, publish_time, data });
                    Ok(())
                }
                None => Err(McapError::UnknownChannel(header.sequence, header.channel_id)),
            },
            Ok(Record::DataEnd(_)) => {
                is_summary = true;
                Ok(())
            }
            Ok(_) => Ok(()),
            Err(error) => Err(error),
        };
        if let Err(error) = noted {
            return ends(line, &error);
        }
    }
    Ok(None)
}

/// The topics of a file, each with its schema and the number of its messages.
///
/// # Errors
/// `Content` where it is none.
pub(super) fn topics(bytes: &[u8], name: &str) -> Imported<Vec<String>> {
    let mut topics: BTreeMap<(String, String), usize> = BTreeMap::new();
    each(bytes, name, |_, message| {
        let schema = message.channel.schema.as_ref().map_or("", |schema| &schema.name);
        *topics.entry((message.channel.topic.clone(), schema.to_owned())).or_default() += 1;
    })?;
    Ok(topics.into_iter().map(|((topic, schema), n)| format!("{topic} ({schema}, {n})")).collect())
}

/// The type of a channel's messages, where it is one of Protocol Buffers that can be read.
fn descriptor(channel: &Channel<'_>) -> Option<MessageDescriptor> {
    let schema = channel.schema.as_ref().filter(|_| channel.message_encoding == "protobuf")?;
    let files = FileDescriptorSet::decode(&*schema.data).ok()?;
    // prost-reflect 0.16.5 panics at others, of which editions are the common ones.
    let is_known =
        |file: &FileDescriptorProto| matches!(file.syntax.as_deref(), None | Some("proto2" | "proto3"));
    if !files.file.iter().all(is_known) {
        return None;
    }
    DescriptorPool::from_file_descriptor_set(files).ok()?.get_message_by_name(&schema.name)
}

fn recording(bytes: &[u8], name: &str, topic: Option<&str>) -> Imported {
    let (mut others, mut unreadable) = (BTreeSet::new(), None);
    let mut descriptors: BTreeMap<u16, Option<MessageDescriptor>> = BTreeMap::new();
    let mut flights: BTreeMap<String, Flight> = BTreeMap::new();
    let end = each(bytes, name, |line, message| {
        let channel = &message.channel;
        let is_measurement = channel.schema.as_ref().is_some_and(|schema| schema.name == SCHEMA);
        if !is_measurement || topic.is_some_and(|topic| topic != channel.topic) {
            others.insert(channel.topic.clone());
            return;
        }
        let Some(descriptor) = descriptors.entry(channel.id).or_insert_with(|| descriptor(channel)) else {
            unreadable = Some(channel.topic.clone());
            return;
        };
        let sample = DynamicMessage::decode(descriptor.clone(), &*message.data).ok();
        let sample = sample.and_then(|message| measurement(&message));
        flights.entry(channel.topic.clone()).or_insert_with(Flight::new).add(line, sample);
    })?;
    if let Some(topic) = unreadable {
        return Err(wrong(name, format!("{topic}: its messages are '{UNREADABLE}'; {READABLE}")));
    }
    let list = |topics: Vec<&str>| match topics.is_empty() {
        true => "none".to_owned(),
        false => topics.join(", "),
    };
    let ending = end.as_ref().map(|(_, end)| format!("; {end}")).unwrap_or_default();
    if flights.len() > 1 {
        let found = list(flights.keys().map(String::as_str).collect());
        return Err(wrong(
            name,
            format!("it has measurements of several vehicles; needed: --topic, one of {found}"),
        ));
    }
    match flights.into_values().next() {
        Some(Flight { mut collector, .. }) => {
            if let Some((line, _)) = end {
                collector.skipped.add(SkipReason::EndsEarly, line);
            }
            collector.finish(name, None)
        }
        None => {
            let found = list(others.iter().map(String::as_str).collect());
            let needed = topic.unwrap_or("a recording of monitor record");
            let found = format!(
                "no measurements; needed: {needed}, or --column KEY=/topic:path.to.field; its topics: {found}{ending}"
            );
            Err(wrong(name, found))
        }
    }
}

/// One vehicle's samples.
struct Flight {
    collector: Collector,
    first_sequence: u64,
}

impl Flight {
    fn new() -> Self {
        Self { collector: Collector::of_recording(), first_sequence: 0 }
    }

    fn add(&mut self, line: u64, sample: Option<Measurement>) {
        let Some(sample) = sample else {
            self.collector.skipped.add(SkipReason::NotANumber, line);
            return;
        };
        let previous = self.collector.samples.last().map(|previous| previous.sequence);
        if !self.collector.add(line, i128::from(sample.stamp_ns), sample) {
            return;
        }
        if previous.is_none() {
            self.first_sequence = sample.sequence;
        }
        if let Some(added) = self.collector.samples.last_mut() {
            // Losses are kept, unless the source has begun again or the number is damaged.
            let next = previous.map_or(0, |previous| previous + 1);
            let since_first = sample.sequence.saturating_sub(self.first_sequence).max(next);
            added.sequence = if since_first - next > MAX_SEQUENCE_GAP { next } else { since_first };
        }
    }
}

/// A sample from its message; `None` if a field has another type.
fn measurement(message: &DynamicMessage) -> Option<Measurement> {
    let mut sample = Measurement::at(unsigned(message, "stamp_ns")?, unsigned(message, "sequence")?);
    let valid = u32::try_from(unsigned(message, "valid")?).ok()?;
    sample.velocity_frame = u32::try_from(unsigned(message, "velocity_frame")?).ok()?;
    // Recordings of version 2 have none.
    sample.flags = u32::try_from(unsigned(message, "flags").unwrap_or(0)).ok()?;
    for (place, field, _) in Measurement::quantities().filter(|(_, field, _)| valid & field.valid != 0) {
        let name = field.name.strip_suffix("_wxyz").unwrap_or(field.name);
        let numbers = match field.components.names {
            [] => numbers(message, name)?,
            names => components(message, name, names)?,
        };
        if numbers.len() != sample.numbers(place).len() {
            return None;
        }
        sample.set(place, &numbers);
    }
    sample.valid = valid;
    Some(sample)
}

/// Where a column is: a topic, and a path within its messages.
#[derive(PartialEq, Eq)]
struct Place<'a> {
    column: &'a str,
    topic: &'a str,
    path: &'a str,
}

/// A flight from numbers of any channels: a table, with a row for each instant at which one was logged.
fn channels(bytes: &[u8], name: &str, map: &CsvMap) -> Imported {
    if map.time_s.is_some() || map.time.is_some() || map.separator.is_some() {
        return Err(ImportError::Option(
            "time and separator are for --format csv; an MCAP file has its own time".into(),
        ));
    }
    let mut places: Vec<Place<'_>> = Vec::new();
    for column in map.columns.values() {
        let (topic, path) = column.rsplit_once(':').ok_or_else(|| {
            ImportError::Option(format!("--column KEY={column}: needed: KEY=/topic:path.to.field"))
        })?;
        let place = Place { column, topic, path };
        if !places.contains(&place) {
            places.push(place);
        }
    }
    let mut found = vec![false; places.len()];
    let mut topics: BTreeMap<String, String> = BTreeMap::new();
    let mut descriptors: BTreeMap<u16, Option<MessageDescriptor>> = BTreeMap::new();
    let mut rows: BTreeMap<u64, Vec<Option<f64>>> = BTreeMap::new();
    let end = each(bytes, name, |_, message| {
        let channel = &message.channel;
        if !topics.contains_key(&channel.topic) {
            topics.insert(channel.topic.clone(), channel.message_encoding.clone());
        }
        if places.iter().all(|place| place.topic != channel.topic) {
            return;
        }
        let Some(fields) = (match channel.message_encoding.as_str() {
            "json" => serde_json::from_slice(&message.data).ok().map(Fields::Json),
            "protobuf" => match descriptors.entry(channel.id).or_insert_with(|| descriptor(channel)) {
                Some(descriptor) => {
                    DynamicMessage::decode(descriptor.clone(), &*message.data).ok().map(Fields::Protobuf)
                }
                None => {
                    topics.insert(channel.topic.clone(), UNREADABLE.into());
                    None
                }
            },
            _ => None,
        }) else {
            return;
        };
        let row = rows.entry(message.log_time).or_insert_with(|| vec![None; places.len()]);
        for ((cell, found), place) in row.iter_mut().zip(&mut found).zip(&places) {
            if place.topic == channel.topic {
                *cell = fields.number(place.path).or(*cell);
                *found |= cell.is_some();
            }
        }
    })?;
    if let Some((place, _)) = places.iter().zip(&found).find(|(_, found)| !**found) {
        let Place { column, topic, path } = place;
        return Err(wrong(
            name,
            match topics.get(*topic) {
                None => {
                    let topics = topics.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                    format!("--column …={column}: no topic '{topic}'; its topics: {topics}")
                }
                Some(encoding) if encoding != "json" && encoding != "protobuf" => {
                    format!("--column …={column}: its messages are '{encoding}'; {READABLE}")
                }
                Some(_) => format!("--column …={column}: no message has a number at '{path}'"),
            },
        ));
    }
    let mut table = csv::Writer::from_writer(Vec::new());
    let cannot = |error: &dyn std::fmt::Display| wrong(name, error.to_string());
    let header = std::iter::once(TIME).chain(places.iter().map(|place| place.column));
    table.write_record(header).map_err(|error| cannot(&error))?;
    for (time_ns, row) in rows {
        let numbers = row.into_iter().map(|cell| cell.map_or(String::new(), |number| format!("{number:?}")));
        let cells = std::iter::once(time_ns.to_string()).chain(numbers);
        table.write_record(cells).map_err(|error| cannot(&error))?;
    }
    let table = table.into_inner().map_err(|error| cannot(&error))?;
    let map = CsvMap { time: Some(TIME.into()), time_unit: Some(TimeUnit::Ns), ..map.clone() };
    let mut flight = table::parse(&table, name, &map)?;
    if let Some((line, _)) = end {
        flight.skipped.add(SkipReason::EndsEarly, line);
    }
    Ok(flight)
}

/// In place of an encoding.
const UNREADABLE: &str = "protobuf of an edition, or without a whole descriptor";
const READABLE: &str = "needed: json or protobuf (proto2, proto3)";
/// Column of the time when a message was logged.
const TIME: &str = "log_time_ns";

/// A message of either kind.
enum Fields {
    Json(serde_json::Value),
    Protobuf(DynamicMessage),
}

impl Fields {
    /// The number at a path: names of fields, and places in lists, with dots between them.
    fn number(&self, path: &str) -> Option<f64> {
        let mut steps = path.split('.');
        match self {
            Self::Json(value) => {
                let value = steps.try_fold(value, |value, step| match value {
                    serde_json::Value::Array(list) => list.get(step.parse::<usize>().ok()?),
                    value => value.get(step),
                })?;
                value.as_f64()
            }
            Self::Protobuf(message) => {
                let mut value = Value::Message(message.clone());
                for step in steps {
                    value = match &value {
                        Value::Message(message) => {
                            let field = message.descriptor().get_field_by_name(step)?;
                            if field.supports_presence() && !message.has_field(&field) {
                                return None;
                            }
                            message.get_field(&field).into_owned()
                        }
                        Value::List(list) => list.get(step.parse::<usize>().ok()?)?.clone(),
                        _ => return None,
                    };
                }
                match value {
                    Value::F64(number) => Some(number),
                    Value::F32(number) => Some(number.into()),
                    Value::I32(number) => Some(number.into()),
                    Value::U32(number) => Some(number.into()),
                    _ => None,
                }
            }
        }
    }
}

fn unsigned(message: &DynamicMessage, field: &str) -> Option<u64> {
    match *message.get_field_by_name(field)? {
        Value::U64(number) => Some(number),
        Value::U32(number) => Some(number.into()),
        _ => None,
    }
}

fn components(message: &DynamicMessage, field: &str, names: &[&str]) -> Option<Vec<f64>> {
    let descriptor = message.descriptor().get_field_by_name(field)?;
    if !message.has_field(&descriptor) {
        return None;
    }
    let value = message.get_field(&descriptor);
    let vector = value.as_message()?;
    names.iter().map(|name| vector.get_field_by_name(name)?.as_f64()).collect()
}

fn numbers(message: &DynamicMessage, field: &str) -> Option<Vec<f64>> {
    message.get_field_by_name(field)?.as_list()?.iter().map(Value::as_f64).collect()
}

/// The reader's error as text.
fn told(error: &McapError) -> String {
    match error {
        McapError::BadMagic => "it does not begin as an MCAP file".into(),
        McapError::UnexpectedEof => "it ends in the middle of a record".into(),
        McapError::UnsupportedCompression(name) => {
            format!("compressed by '{name}'; needed: lz4 or none (mcap compress --compression lz4)")
        }
        error => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcap::{Compression, WriteOptions};
    use prost_reflect::prost_types::field_descriptor_proto::{Label, Type};
    use prost_reflect::prost_types::{DescriptorProto, EnumDescriptorProto, FieldDescriptorProto};
    use std::io::Cursor;

    /// JSON messages: topic, time (ns), text.
    fn file(messages: &[(&str, u64, &str)], compression: Option<Compression>) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer =
            WriteOptions::new().compression(compression).create(Cursor::new(&mut bytes)).unwrap();
        for (sequence, &(topic, log_time, text)) in (0..).zip(messages) {
            let channel_id = writer.add_channel(0, topic, "json", &BTreeMap::new()).unwrap();
            let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, text.as_bytes()).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        bytes
    }

    fn map(columns: &[&str]) -> ImportOptions {
        let columns: Vec<String> = columns.iter().map(ToString::to_string).collect();
        ImportOptions { columns: CsvMap::read(None, &columns).unwrap(), ..ImportOptions::default() }
    }

    const VELOCITY: [&str; 3] = ["velocity_x=/dvl:v.0", "velocity_y=/dvl:v.1", "velocity_z=/dvl:v.2"];

    #[test]
    fn channels_of_others_are_joined_by_time() {
        let messages = [
            ("/imu", 1_000_000_010, r#"{"rates": {"p": 0.1, "q": 0.2, "r": -0.0}}"#),
            ("/dvl", 1_000_000_000, r#"{"v": [1, 2.5, 1e-300]}"#),
            ("/dvl", 1_000_000_010, r#"{"v": [2, 2.5, 3]}"#),
            ("/dvl", 1_000_000_020, r#"{"v": [2, null]}"#),
            ("/dvl", 1_000_000_030, "no JSON"),
        ];
        let rates =
            ["x=/imu:rates.p", "y=/imu:rates.q", "z=/imu:rates.r"].map(|c| format!("angular_velocity_{c}"));
        let columns: Vec<&str> = VELOCITY.into_iter().chain(rates.iter().map(String::as_str)).collect();
        for compression in [None, Some(Compression::Lz4)] {
            let flight = parse(&file(&messages, compression), "file", &map(&columns)).unwrap();
            let expected = [
                Measurement::at(0, 0).with_velocity_m_s([1.0, 2.5, 1e-300]),
                Measurement::at(10, 1)
                    .with_velocity_m_s([2.0, 2.5, 3.0])
                    .with_angular_velocity_rad_s([0.1, 0.2, -0.0]),
            ];
            assert_eq!(flight.samples, expected);
            assert!(flight.samples[1].angular_velocity_rad_s[2].is_sign_negative());
            assert_eq!(flight.skipped.for_reason(SkipReason::NothingMeasured), 1);
        }
    }

    #[test]
    fn what_is_not_there_is_said() {
        let bytes = file(&[("/dvl", 1, r#"{"v": [1, 2]}"#), ("/other", 2, "{}")], None);
        let refused =
            |bytes: &[u8], columns: &[&str]| parse(bytes, "file", &map(columns)).unwrap_err().to_string();
        assert!(refused(&bytes, &VELOCITY).contains("no message has a number at 'v.2'"));
        let error = refused(&bytes, &["velocity_x=/none:v"]);
        assert!(error.contains("no topic '/none'; its topics: /dvl, /other"), "{error}");
        assert!(refused(&bytes, &["velocity_x=v"]).contains("needed: KEY=/topic:path.to.field"));
        let error = refused(&bytes, &[]);
        assert!(error.contains("no measurements") && error.contains("/dvl, /other"), "{error}");
        assert!(refused(b"0123456789 garbage", &[]).contains("does not begin as an MCAP file"));
        assert!(refused(b"", &[]).contains("in the middle"));
    }

    /// A file with one message of a type whose descriptor's file is this one.
    fn of_type(file: FileDescriptorProto) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = WriteOptions::new().compression(None).create(Cursor::new(&mut bytes)).unwrap();
        let descriptor = FileDescriptorSet { file: vec![file] }.encode_to_vec();
        let schema = writer.add_schema("p.Dvl", "protobuf", &descriptor).unwrap();
        let channel_id = writer.add_channel(schema, "/dvl", "protobuf", &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        // Field 1, a double: 2.5.
        let message = [&[0x09], &2.5_f64.to_le_bytes()[..]].concat();
        writer.write_to_known_channel(&header, &message).unwrap();
        writer.finish().unwrap();
        drop(writer);
        bytes
    }

    #[test]
    fn types_that_cannot_be_read_are_said_and_end_nothing() {
        let field = FieldDescriptorProto {
            name: Some("v".into()),
            number: Some(1),
            label: Some(Label::Optional.into()),
            r#type: Some(Type::Double.into()),
            ..Default::default()
        };
        let dvl = DescriptorProto { name: Some("Dvl".into()), field: vec![field], ..Default::default() };
        let file = |syntax: &str| FileDescriptorProto {
            name: Some("p.proto".into()),
            package: Some("p".into()),
            syntax: Some(syntax.into()),
            message_type: vec![dvl.clone()],
            ..Default::default()
        };
        let columns = ["x", "y", "z"].map(|axis| format!("velocity_{axis}=/dvl:v"));
        let map = map(&columns.each_ref().map(String::as_str));
        let flight = parse(&of_type(file("proto3")), "file", &map).unwrap();
        assert_eq!(flight.samples[0].velocity_m_s, [2.5; 3]);
        let without_values = EnumDescriptorProto { name: Some("E".into()), ..Default::default() };
        let refused = FileDescriptorProto { enum_type: vec![without_values], ..file("proto3") };
        for file in [file("editions"), file("proto6"), file(""), refused] {
            let error = parse(&of_type(file), "file", &map).unwrap_err().to_string();
            assert!(
                error.contains("protobuf of an edition") && error.contains("(proto2, proto3)"),
                "{error}"
            );
        }
    }

    #[test]
    fn damaged_sequences_are_no_losses() {
        let mut flight = Flight::new();
        for (ns, sequence) in (0..).zip([7, 9, u64::MAX, 10, 11]) {
            let sample = Measurement::at(ns, sequence).with_velocity_m_s([0.0; 3]);
            flight.add(ns, Some(sample));
        }
        let sequences: Vec<_> = flight.collector.samples.iter().map(|sample| sample.sequence).collect();
        assert_eq!(sequences, [0, 2, 3, 4, 5]);
    }

    #[test]
    fn a_file_that_is_cut_is_read_up_to_there() {
        let messages: Vec<(&str, u64, &str)> =
            (0..100).map(|ms| ("/dvl", 1_000_000 * ms, r#"{"v": [1, 2, 3]}"#)).collect();
        let bytes = file(&messages, None);
        let mut n_before = 0;
        for end in 0..bytes.len() {
            if let Ok(flight) = parse(&bytes[..end], "file", &map(&VELOCITY)) {
                assert!(flight.samples.len() >= n_before);
                n_before = flight.samples.len();
            }
        }
        assert_eq!(n_before, 100);
    }
}
