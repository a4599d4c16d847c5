//! Turns bytes into numbers, stamps and samples that often reveal faults.

use shared_types::Measurement;
use shared_types::payload::{flags, frame, valid};

/// The bytes of one run, read from the front; where they end, zeros follow.
pub(crate) struct Bytes<'a>(
    /// Those not read yet.
    pub(crate) &'a [u8],
);

impl Bytes<'_> {
    /// Whether none is left.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        let n = N.min(self.0.len());
        let (taken, rest) = self.0.split_at(n);
        self.0 = rest;
        let mut array = [0; N];
        array[..n].copy_from_slice(taken);
        array
    }

    pub(crate) fn byte(&mut self) -> u8 {
        self.array::<1>()[0]
    }

    /// A number: near zero, of the size of speeds, forces or distances, special, or any bits at all.
    pub(crate) fn number(&mut self) -> f64 {
        const SPECIAL: [f64; 16] = [
            0.0,
            -0.0,
            1.0,
            -1.0,
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::MAX,
            f64::MIN,
            f64::MIN_POSITIVE,
            5e-324,
            -5e-324,
            1e5,
            1e6,
            1e9,
            99.999,
        ];
        match self.byte() {
            kind @ 0..=15 => SPECIAL[usize::from(kind)],
            16..=31 => f64::from_le_bytes(self.array()),
            32..=47 => f64::from(f32::from_le_bytes(self.array())),
            kind => {
                let scale = [1e-6, 1e-3, 1e-2, 1.0, 30.0][usize::from(kind) % 5];
                f64::from(i16::from_le_bytes(self.array())) * scale
            }
        }
    }

    /// Numbers, each as [`Bytes::number`].
    pub(crate) fn numbers<const N: usize>(&mut self) -> [f64; N] {
        [(); N].map(|()| self.number())
    }

    /// A signed duration: mostly about a sample's period, now and then anything (ns).
    pub(crate) fn gap_ns(&mut self) -> i128 {
        match self.byte() {
            0 => 0,
            1 => i128::from(i64::from_le_bytes(self.array())),
            2 => i128::from(u64::from_le_bytes(self.array())),
            3 => 1,
            4 => -1,
            5..=20 => i128::from(i16::from_le_bytes(self.array())) * 1_000_000_000,
            21..=60 => i128::from(i16::from_le_bytes(self.array())) * 1_000_000,
            _ => i128::from(self.byte()) * 100_000,
        }
    }

    /// A stamp that far from `from_ns`.
    pub(crate) fn stamp_ns(&mut self, from_ns: u64) -> u64 {
        (i128::from(from_ns) + self.gap_ns()).clamp(0, i128::from(u64::MAX)) as u64
    }

    /// A quaternion: often of unit norm.
    pub(crate) fn quaternion(&mut self) -> [f64; 4] {
        let raw: [f64; 4] = self.numbers();
        let norm = raw.iter().map(|x| x * x).sum::<f64>().sqrt();
        if self.byte() < 200 && norm.is_finite() && norm > 0.0 { raw.map(|x| x / norm) } else { raw }
    }

    /// A sample with any fields, stamped somewhere around `near_ns`, numbered after `sequence`.
    pub(crate) fn measurement(&mut self, near_ns: u64, sequence: u64) -> Measurement {
        let mut m = Measurement::at(self.stamp_ns(near_ns), sequence.wrapping_add(1));
        if self.byte() < 32 {
            m.sequence = u64::from_le_bytes(self.array());
        }
        let bits = u32::from(self.byte());
        m.valid = if self.byte() < 8 { u32::from_le_bytes(self.array()) } else { bits & valid::ALL };
        let kind = self.byte();
        m.velocity_frame = match kind {
            0 => u32::from_le_bytes(self.array()),
            kind if kind % 2 == 1 => frame::BODY,
            _ => frame::INERTIAL,
        };
        m.flags = match kind {
            1 => u32::from_le_bytes(self.array()),
            32..=63 => flags::ON_GROUND,
            _ => 0,
        };
        let mut fill = |bit: u32, field: &mut [f64]| {
            if m.valid & bit != 0 {
                field.iter_mut().for_each(|x| *x = self.number());
            }
        };
        fill(valid::VELOCITY, &mut m.velocity_m_s);
        fill(valid::ANGULAR_VELOCITY, &mut m.angular_velocity_rad_s);
        fill(valid::POSITION, &mut m.position_m);
        fill(valid::FORCE, &mut m.force_n);
        fill(valid::TORQUE, &mut m.torque_n_m);
        fill(valid::OUTPUT, &mut m.output);
        fill(valid::INPUT, &mut m.input);
        if m.valid & valid::ATTITUDE != 0 {
            m.attitude_wxyz = self.quaternion();
        }
        let more = self.byte();
        if more & 1 != 0 {
            m.valid |= valid::SPECIFIC_FORCE;
            m.specific_force_m_s2 = self.numbers();
        }
        m.force_frame = u32::from(more >> 1 & 1);
        m.sensor = u32::from(more >> 2 & 3);
        if more & 16 != 0 {
            m.absent = u32::from(u16::from_le_bytes(self.array()));
        }
        if more & 32 != 0 {
            m.velocity_std_m_s = self.numbers();
            m.position_std_m = self.numbers();
            m.specific_force_std_m_s2 = self.numbers();
        }
        m
    }
}
