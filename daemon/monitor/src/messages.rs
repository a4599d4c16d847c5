//! The service's messages in recordings and live streams: Protocol Buffers with their schema, made from the tables of
//! [`shared_types::payload`]. Depends on these tables alone.
//!
//! | field of a payload | in a recording |
//! |---|---|
//! | several numbers with names | a message with these names: `velocity_m_s.x`, `samples_rejected.too_late` |
//! | several numbers without | a list |
//! | another payload | a message; the counters of a status stand among its own fields |
//! | bits of an estimate's status | the number, and `status_words` |
//! | other bits that have words | the words |
//! | not valid, unknown whole numbers, or of a plant that is not estimated | absent |
//!
//! Names and units are those of the payload (`attitude_wxyz` is `attitude`). Everything else is written, infinities and
//! zeros too: a recording holds the bits that were sent.

use foxglove::bytes::BufMut;
use foxglove::prost_types::field_descriptor_proto::{Label, Type};
use foxglove::prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, OneofDescriptorProto,
};
use foxglove::{Encode, FoxgloveError, Schema};
use shared_types::payload::{Counters, Estimate, Measurement};
use shared_types::table::{Field, Kind, Message, Payload, Scalar, Table, Value};

/// A payload that is being written to a recording.
#[derive(Debug, Clone, Copy)]
pub struct Recorded<T>(pub T);

/// A payload that is recorded.
pub trait Recordable: Payload + Copy {
    /// Whether this message has the field.
    fn has(&self, _field: &Field) -> bool {
        true
    }
}

impl Recordable for Measurement {
    fn has(&self, field: &Field) -> bool {
        Measurement::has(self, field.valid)
    }
}

impl Recordable for Estimate {
    fn has(&self, field: &Field) -> bool {
        !["linear", "state", "matched_input"].contains(&field.name) || self.has_linear_plant()
    }
}

impl Recordable for shared_types::Truth {}
impl Recordable for shared_types::Status {}

impl<T: Recordable> Encode for Recorded<T> {
    type Error = FoxgloveError;

    fn get_schema() -> Option<Schema> {
        let (name, package) = (T::TABLE.name, T::TABLE.name.to_lowercase());
        let file = FileDescriptorProto {
            name: Some(format!("{name}.proto")),
            package: Some(package.clone()),
            syntax: Some("proto3".into()),
            message_type: vec![descriptor(&T::TABLE)],
            ..Default::default()
        };
        let files = FileDescriptorSet { file: vec![file] };
        let data = foxglove::protobuf::prost_file_descriptor_set_to_vec(&files);
        Some(Schema { name: format!("{package}.{name}"), encoding: "protobuf".into(), data: data.into() })
    }

    fn get_message_encoding() -> String {
        "protobuf".into()
    }

    fn encode(&self, buffer: &mut impl BufMut) -> Result<(), FoxgloveError> {
        let mut bytes = Vec::with_capacity(2 * size_of::<T>());
        write_message(&self.0, 1, &|field| self.0.has(field), &mut bytes);
        if bytes.len() > buffer.remaining_mut() {
            return Err(FoxgloveError::EncodeError("insufficient buffer".into()));
        }
        buffer.put_slice(&bytes);
        Ok(())
    }
}

/// A field's name in a recording.
fn name_of(field: &Field) -> &'static str {
    field.name.strip_suffix("_wxyz").unwrap_or(field.name)
}

/// Whether the fields of this one stand among those of the message that holds it.
fn is_flat(field: &Field) -> bool {
    matches!(field.kind, Kind::Message(table) if table.name == Counters::TABLE.name)
}

/// How the words of a field's bits are recorded.
fn says(field: &Field) -> Words {
    match (field.words, field.name) {
        (None, _) => Words::None,
        (Some(_), "status") => Words::Beside,
        (Some(_), _) => Words::Instead,
    }
}

#[derive(PartialEq, Eq)]
enum Words {
    None,
    Beside,
    Instead,
}

/// The schema of a payload.
fn descriptor(table: &Table) -> DescriptorProto {
    let mut message = DescriptorProto { name: Some(table.name.into()), ..Default::default() };
    describe(table, &mut message);
    message
}

/// Adds a payload's fields to a schema, numbered as [`write_message`] does.
fn describe(table: &Table, message: &mut DescriptorProto) {
    for field in table.fields {
        let words = says(field);
        match field.kind {
            Kind::Message(counters) if is_flat(field) => describe(counters, message),
            Kind::Message(held) => {
                add_type(message, descriptor(held));
                add(message, name_of(field), Type::Message, Some(held.name), true, false);
            }
            Kind::Many(scalar, _) if !field.components.names.is_empty() => {
                let components = &field.components;
                let mut held = DescriptorProto { name: Some(components.name.into()), ..Default::default() };
                for name in components.names {
                    add(&mut held, name, type_of(scalar), None, field.unknown.is_some(), false);
                }
                add_type(message, held);
                add(message, name_of(field), Type::Message, Some(components.name), true, false);
            }
            Kind::Many(scalar, _) => add(message, name_of(field), type_of(scalar), None, false, true),
            Kind::One(_) if words == Words::Instead => {
                add(message, name_of(field), Type::String, None, false, false);
            }
            Kind::One(scalar) => {
                add(message, name_of(field), type_of(scalar), None, field.unknown.is_some(), false);
            }
        }
        if words == Words::Beside {
            add(message, &format!("{}_words", field.name), Type::String, None, false, false);
        }
    }
}

fn add_type(message: &mut DescriptorProto, held: DescriptorProto) {
    if !message.nested_type.iter().any(|known| known.name == held.name) {
        message.nested_type.push(held);
    }
}

fn add(
    message: &mut DescriptorProto,
    name: &str,
    kind: Type,
    of: Option<&str>,
    is_optional: bool,
    is_list: bool,
) {
    // A group of one field records presence, as protoc does it.
    let group = is_optional.then_some(message.oneof_decl.len() as i32);
    if is_optional {
        let name = Some(format!("_{name}"));
        message.oneof_decl.push(OneofDescriptorProto { name, ..Default::default() });
    }
    message.field.push(FieldDescriptorProto {
        name: Some(name.into()),
        number: Some(message.field.len() as i32 + 1),
        label: Some(if is_list { Label::Repeated } else { Label::Optional } as i32),
        r#type: Some(kind as i32),
        type_name: of.map(Into::into),
        oneof_index: group,
        proto3_optional: is_optional.then_some(true),
        ..Default::default()
    });
}

fn type_of(scalar: Scalar) -> Type {
    match scalar {
        Scalar::U8 => Type::Bytes,
        Scalar::U32 => Type::Uint32,
        Scalar::U64 => Type::Uint64,
        Scalar::F64 => Type::Double,
    }
}

/// Writes the fields for which `has` is true, from this number on; returns the number after the last one.
fn write_message(message: &dyn Message, first: u64, has: &dyn Fn(&Field) -> bool, out: &mut Vec<u8>) -> u64 {
    let mut number = first;
    for (i, field) in message.table().fields.iter().enumerate() {
        let value = message.value(i);
        if let (Value::Message(counters), true) = (value, is_flat(field)) {
            number = write_message(counters, number, &|_| true, out);
            continue;
        }
        let is_known = !matches!(value, Value::Integer(number) if field.unknown == Some(number));
        let words = says(field);
        if words != Words::Instead && is_known && has(field) {
            write_value(field, value, number, out);
        }
        number += u64::from(words != Words::Instead);
        if let (Some(table), Value::Integer(bits)) = (field.words, value) {
            let separator = if words == Words::Beside { " " } else { ", " };
            write_bytes(number, table.words(bits).join(separator).as_bytes(), out);
            number += 1;
        }
    }
    number
}

fn write_value(field: &Field, value: Value<'_>, number: u64, out: &mut Vec<u8>) {
    let mut held = Vec::new();
    let is_list = field.components.names.is_empty();
    match value {
        Value::Integer(value) => return write_integer(number, value, out),
        Value::Number(value) => return write_number(number, value, out),
        Value::Numbers(values) if is_list => values.iter().for_each(|value| held.put_f64_le(*value)),
        Value::Integers(values) if is_list => values.iter().for_each(|value| write_varint(*value, &mut held)),
        Value::Numbers(values) => (1..).zip(values).for_each(|(n, value)| write_number(n, *value, &mut held)),
        Value::Integers(values) => {
            let known = (1..).zip(values).filter(|(_, value)| field.unknown != Some(**value));
            known.for_each(|(n, value)| write_integer(n, *value, &mut held));
        }
        Value::Bytes(bytes) => held.extend(bytes),
        Value::Message(message) => _ = write_message(message, 1, &|_| true, &mut held),
    }
    write_bytes(number, &held, out);
}

fn write_varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn write_integer(number: u64, value: u64, out: &mut Vec<u8>) {
    write_varint(number << 3, out);
    write_varint(value, out);
}

fn write_number(number: u64, value: f64, out: &mut Vec<u8>) {
    write_varint(number << 3 | 1, out);
    out.put_f64_le(value);
}

fn write_bytes(number: u64, bytes: &[u8], out: &mut Vec<u8>) {
    write_varint(number << 3 | 2, out);
    write_varint(bytes.len() as u64, out);
    out.extend(bytes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Status;

    fn encoded<T: Recordable>(message: T) -> Vec<u8> {
        let mut bytes = Vec::new();
        Recorded(message).encode(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn what_a_sample_does_not_carry_is_absent_and_the_rest_is_there_to_the_bit() {
        let sample = Measurement::at(5, 2).with_velocity_m_s([-0.0, f64::INFINITY, 1.0]);
        // sequence, stamp, valid, frame, flags, absent, sensor, frame; field 9 of 27 bytes: three doubles with their tags.
        let mut needed =
            vec![0x08, 2, 0x10, 5, 0x18, 1, 0x20, 0, 0x28, 0, 0x30, 0, 0x38, 0, 0x40, 0, 0x4a, 27];
        for (tag, value) in [(0x09, -0.0_f64), (0x11, f64::INFINITY), (0x19, 1.0)] {
            needed.push(tag);
            needed.extend(value.to_le_bytes());
        }
        // Fields 18 to 22, the deviations: always there.
        for tag in [[0x92, 1], [0x9a, 1], [0xa2, 1], [0xaa, 1], [0xb2, 1]] {
            needed.extend(tag);
            needed.push(27);
            for component in [0x09, 0x11, 0x19] {
                needed.push(component);
                needed.extend(0.0_f64.to_le_bytes());
            }
        }
        assert_eq!(encoded(sample), needed);
    }

    #[test]
    fn an_unknown_age_of_one_channel_is_absent_and_the_others_are_there() {
        let status = Status { output_age_ns: [u64::MAX, 7, u64::MAX], ..Status::default() };
        let of_status = descriptor(&Status::TABLE);
        let number = of_status.field.iter().find(|field| field.name() == "output_age_ns").unwrap().number();
        // The rotation is component 2.
        let mut needed = Vec::new();
        write_bytes(number as u64, &[0x10, 7], &mut needed);
        assert!(encoded(status).windows(needed.len()).any(|window| window == needed), "{needed:?}");
        let ages = of_status.nested_type.iter().find(|held| held.name() == "AgePerChannel").unwrap();
        assert!(ages.field.iter().all(|component| component.proto3_optional()));
    }

    #[test]
    fn the_schema_numbers_fields_as_the_messages_do() {
        let descriptor = descriptor(&Status::TABLE);
        let number =
            |name: &str| descriptor.field.iter().find(|field| field.name() == name).unwrap().number();
        let mut status = Status { newest_sample_age_ns: u64::MAX, ..Status::default() };
        let without = encoded(status);
        status.newest_sample_age_ns = 1;
        let with = encoded(status);
        // One field more, of a two-byte tag and one byte.
        let tag = number("newest_sample_age_ns") as u64;
        let mut needed = Vec::new();
        write_integer(tag, 1, &mut needed);
        assert_eq!(with.len(), without.len() + needed.len());
        assert!(with.windows(needed.len()).any(|window| window == needed), "{needed:?}");
        assert_eq!(number("ticks"), number("dead_zone_width") + 1, "counters stand among the fields");
        assert_eq!(descriptor.field.last().unwrap().name(), "source_to_publish_ns");
    }
}
