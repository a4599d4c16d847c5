//! Sizes and offsets of the payloads, as this library was compiled: the header asserts them, and its hash
//! tells a program that was compiled with the header of another version.

use shared_types::{Channel, Estimate, LatencySummary, Measurement, Status, payload::Reply};
use std::mem::offset_of;

/// Where the fields of one payload lie (bytes).
#[derive(Debug)]
pub struct Layout {
    /// Name in C.
    pub name: &'static str,
    /// Size of the whole.
    pub bytes: usize,
    /// Name and offset of every field.
    pub fields: &'static [(&'static str, usize)],
}

macro_rules! layouts {
    ($($name:literal = $type:ident { $($field:ident),+ })+) => {
        /// Every payload of the header.
        pub const LAYOUTS: &[Layout] = &[$(Layout {
            name: $name,
            bytes: size_of::<$type>(),
            fields: &[$((stringify!($field), offset_of!($type, $field))),+],
        }),+];
        // Does not compile while a field is missing above.
        $(const _: fn($type) = |$type { $($field: _),+ }| ();)+
    };
}

layouts! {
    "observer_measurement" = Measurement {
        sequence, stamp_ns, valid, velocity_frame, velocity_m_s, angular_velocity_rad_s, position_m, attitude_wxyz,
        force_n, torque_n_m, output, input
    }
    "observer_channel" = Channel {
        output_error, activation, power_function, native_norm, solver_error, error_bound, output_age_s
    }
    "observer_estimate" = Estimate {
        sequence, source_sequence, stamp_ns, source_stamp_ns, publish_stamp_ns, status, position_m, velocity_m_s,
        attitude_wxyz, euler_rad, angular_velocity_rad_s, matched_force_n, matched_torque_n_m, translation, rotation,
        state, matched_input, linear
    }
    "observer_latency_summary" = LatencySummary { count, p50, p90, p99, p999, max }
    "observer_status" = Status {
        sequence, stamp_ns, start_stamp_ns, rate_millihertz, dead_zone_width, ticks, deadline_misses,
        samples_accepted, samples_lost, samples_rejected, newest_sequence, newest_sample_age_ns, ticks_coasting, ticks_clamped, state_resets,
        source_changes, source_pid, other_source_pid, commands, records_dropped, adaptation_frozen, outputs_held_back,
        outputs_stuck, late_ticks_in_a_row, most_late_ticks_in_a_row, ticks_predict_only, ticks_invalid,
        real_time_requested, real_time_granted, snapshot_restored, snapshots_saved, snapshots_failed,
        snapshot_stamp_ns, ticks_recorded, ticks_not_recorded, wake_up_lateness_ns, step_ns, input_age_ns,
        source_to_publish_ns
    }
    "observer_reply" = Reply { outcome, message_bytes, message, status }
}

/// FNV-1a over names, sizes and offsets: another layout has another number.
pub const HASH: u32 = {
    let mut hash = 0x811c_9dc5;
    let mut i = 0;
    while i < LAYOUTS.len() {
        let Layout { name, bytes, fields } = &LAYOUTS[i];
        hash = hashed(hash, name, *bytes);
        let mut j = 0;
        while j < fields.len() {
            hash = hashed(hash, fields[j].0, fields[j].1);
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
