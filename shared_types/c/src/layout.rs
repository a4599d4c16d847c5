//! The payloads as C programs use them, and a number that identifies the version of their layout.

use shared_types::table::{Payload, Table};
use shared_types::{Channel, Counters, Estimate, LatencySummary, Measurement, Reply, Status};

/// Every payload of the header: its name in C, its fields.
pub const LAYOUTS: &[(&str, &Table)] = &[
    ("observer_measurement", &Measurement::TABLE),
    ("observer_channel", &Channel::TABLE),
    ("observer_estimate", &Estimate::TABLE),
    ("observer_latency_summary", &LatencySummary::TABLE),
    ("observer_counters", &Counters::TABLE),
    ("observer_status", &Status::TABLE),
    ("observer_reply", &Reply::TABLE),
];

/// FNV-1a over names, sizes and offsets: another layout has another number.
pub const HASH: u32 = {
    let mut hash = 0x811c_9dc5;
    let mut i = 0;
    while i < LAYOUTS.len() {
        let (name, table) = LAYOUTS[i];
        hash = hashed(hash, name, table.bytes);
        let mut j = 0;
        while j < table.fields.len() {
            hash = hashed(hash, table.fields[j].name, table.fields[j].offset);
            j += 1;
        }
        i += 1;
    }
    hash
};

const fn hashed(mut hash: u32, name: &str, number: usize) -> u32 {
    let (name, number) = (name.as_bytes(), (number as u64).to_le_bytes());
    let mut i = 0;
    while i < name.len() + number.len() {
        let byte = if i < name.len() { name[i] } else { number[i - name.len()] };
        hash = (hash ^ byte as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    hash
}
