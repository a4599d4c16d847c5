//! The measurement, which a vehicle publishes: readings of its sensors, and its commands.

use crate::table::{Bound, Field, Limit, Message, Payload, Quantity, Value, WXYZ, XYZ, numbers_are_finite};
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

/// A sequence further ahead than this is no gap but a damaged number.
pub const MAX_SEQUENCE_GAP: u64 = 1_000_000;
/// A unit quaternion's norm may be off by this much: single precision and a little more.
pub const QUATERNION_NORM_TOLERANCE: f64 = 1e-3;

constants! {
    /// Values of [`Measurement::velocity_frame`] and [`Measurement::force_frame`].
    pub mod frame: u32 {
        /// Components along the inertial axes.
        INERTIAL = 0;
        /// Components along the body axes (a Doppler log; the thrust of a multicopter).
        BODY = 1;
    }
}

constants! {
    /// Bits of [`Measurement::flags`]. A sample with any other bit is malformed, as with any other bit of `valid`.
    pub mod flags: u32 {
        /// The vehicle stands on the ground, by its own landed detector. Nothing is learned while the newest sample has
        /// this bit: the ground's reaction is no force of the motion.
        ON_GROUND = 1 << 0;
        /// Every bit that has a meaning.
        ALL = ON_GROUND;
    }
}

constants! {
    /// Bits of [`Measurement::absent`]: components of a valid field that were not measured, as of a depth or of a Doppler log that
    /// has two axes. The joint law takes the others; a velocity in body axes and a specific force must have all of them.
    pub mod absent: u32 {
        /// x of the velocity.
        VELOCITY_X = 1 << 0;
        /// y of the velocity.
        VELOCITY_Y = 1 << 1;
        /// z of the velocity.
        VELOCITY_Z = 1 << 2;
        /// x of the angular velocity.
        ANGULAR_VELOCITY_X = 1 << 3;
        /// y of the angular velocity.
        ANGULAR_VELOCITY_Y = 1 << 4;
        /// z of the angular velocity.
        ANGULAR_VELOCITY_Z = 1 << 5;
        /// x of the position.
        POSITION_X = 1 << 6;
        /// y of the position.
        POSITION_Y = 1 << 7;
        /// z of the position.
        POSITION_Z = 1 << 8;
        /// x of the specific force.
        SPECIFIC_FORCE_X = 1 << 9;
        /// y of the specific force.
        SPECIFIC_FORCE_Y = 1 << 10;
        /// z of the specific force.
        SPECIFIC_FORCE_Z = 1 << 11;
        /// Every bit that has a meaning.
        ALL = 0xfff;
    }
}

const fn measured(key: &'static str, unit: &'static str) -> Option<Quantity> {
    Some(Quantity { key, unit, is_measured: true })
}

const fn commanded(key: &'static str, unit: &'static str) -> Option<Quantity> {
    Some(Quantity { key, unit, is_measured: false })
}

payload! {
    /// Bits of [`Measurement::valid`]: which fields carry a measurement.
    pub mod valid: u32 {
        /// Every field of a rigid body but the specific force.
        RIGID_BODY = VELOCITY | ANGULAR_VELOCITY | POSITION | ATTITUDE | FORCE | TORQUE,
    }

    /// One set of sensor readings and commands, all taken at `stamp_ns`.
    #[derive(Default, Serialize, Deserialize)]
    pub struct Measurement: "observer.Measurement.v5" {
        /// Counts from 0, one up per sample; a gap counts as loss.
        sequence: u64,
        /// CLOCK_MONOTONIC of the source when the readings were taken (ns).
        stamp_ns: u64,
        /// Which of the fields below are valid: bits of [`valid`].
        valid: u32,
        /// Frame of `velocity_m_s`: [`frame::INERTIAL`] or [`frame::BODY`].
        velocity_frame: u32,
        /// What the vehicle says of itself: bits of [`flags`].
        flags: u32,
        /// Which components of the fields below were not measured: bits of [`absent`].
        absent: u32,
        /// Number of the `[[sensor]]` of the configuration that it comes from: mounting, lever arm, noise, latency. 0: of none.
        sensor: u32,
        /// Frame of `force_n`: [`frame::INERTIAL`] or [`frame::BODY`].
        force_frame: u32,
        /// Velocity of the center of mass, or of the sensor where its configuration has a lever arm, in the frame that
        /// `velocity_frame` names (m/s).
        velocity_m_s: [f64; 3] where VELOCITY = 0 {
            components: XYZ, quantity: measured("velocity", "m/s"), limit: Limit::Norm(Bound::Speed),
        },
        /// Angular velocity, body axes (rad/s).
        angular_velocity_rad_s: [f64; 3] where ANGULAR_VELOCITY = 1 {
            components: XYZ, quantity: measured("angular_velocity", "rad/s"), limit: Limit::Norm(Bound::AngularRate),
        },
        /// Specific force, of an accelerometer: acceleration without gravity's, body axes (m/s²).
        specific_force_m_s2: [f64; 3] where SPECIFIC_FORCE = 8 {
            components: XYZ, quantity: measured("specific_force", "m/s2"), limit: Limit::Norm(Bound::SpecificForce),
        },
        /// Position fix, inertial (m).
        position_m: [f64; 3] where POSITION = 2 {
            components: XYZ, quantity: measured("position", "m"), limit: Limit::Norm(Bound::Position),
        },
        /// Attitude fix, unit quaternion w, x, y, z, body to inertial.
        attitude_wxyz: [f64; 4] where ATTITUDE = 3 {
            components: WXYZ, quantity: measured("attitude", ""), limit: Limit::UnitNorm,
        },
        /// Commanded force, in the frame that `force_frame` names (N), held until the next one; zero before the first.
        force_n: [f64; 3] where FORCE = 4 {
            components: XYZ, quantity: commanded("force", "N"), limit: Limit::Norm(Bound::Force),
        },
        /// Commanded torque, body axes (N·m), held until the next one; zero before the first.
        torque_n_m: [f64; 3] where TORQUE = 5 {
            components: XYZ, quantity: commanded("torque", "N m"), limit: Limit::Norm(Bound::Torque),
        },
        /// y of a general linear plant, its first m entries, in the units of its configuration.
        output: [f64; 6] where OUTPUT = 6 {
            quantity: measured("output", ""), limit: Limit::Each(Bound::Output),
        },
        /// u of a general linear plant, its first m entries, held until the next one; zero before the first.
        input: [f64; 6] where INPUT = 7 {
            quantity: commanded("input", ""), limit: Limit::Each(Bound::Input),
        },
        /// 1 σ of `velocity_m_s`, along its axes (m/s); 0: as configured.
        velocity_std_m_s: [f64; 3] { components: XYZ, limit: Limit::NotNegative },
        /// 1 σ of `angular_velocity_rad_s` (rad/s); 0: as configured.
        angular_velocity_std_rad_s: [f64; 3] { components: XYZ, limit: Limit::NotNegative },
        /// 1 σ of `specific_force_m_s2` (m/s²); 0: as configured.
        specific_force_std_m_s2: [f64; 3] { components: XYZ, limit: Limit::NotNegative },
        /// 1 σ of `position_m` (m); 0: as configured.
        position_std_m: [f64; 3] { components: XYZ, limit: Limit::NotNegative },
        /// 1 σ of the rotation vector of `attitude_wxyz`'s error, body axes (rad); 0: as configured.
        attitude_std_rad: [f64; 3] { components: XYZ, limit: Limit::NotNegative },
    }
}

impl Measurement {
    /// A sample without any valid field yet.
    pub fn at(stamp_ns: u64, sequence: u64) -> Self {
        Self { stamp_ns, sequence, ..Self::default() }
    }

    fn and(mut self, bit: u32) -> Self {
        self.valid |= bit;
        self
    }

    /// Adds an inertial velocity.
    pub fn with_velocity_m_s(self, velocity_m_s: [f64; 3]) -> Self {
        Self { velocity_m_s, velocity_frame: frame::INERTIAL, ..self }.and(valid::VELOCITY)
    }

    /// Adds a velocity along the body axes.
    pub fn with_body_velocity_m_s(self, velocity_m_s: [f64; 3]) -> Self {
        Self { velocity_m_s, velocity_frame: frame::BODY, ..self }.and(valid::VELOCITY)
    }

    /// Adds an angular velocity, body axes.
    pub fn with_angular_velocity_rad_s(self, angular_velocity_rad_s: [f64; 3]) -> Self {
        Self { angular_velocity_rad_s, ..self }.and(valid::ANGULAR_VELOCITY)
    }

    /// Adds a specific force, body axes.
    pub fn with_specific_force_m_s2(self, specific_force_m_s2: [f64; 3]) -> Self {
        Self { specific_force_m_s2, ..self }.and(valid::SPECIFIC_FORCE)
    }

    /// Says which `[[sensor]]` of the configuration it comes from.
    pub fn of_sensor(self, sensor: u32) -> Self {
        Self { sensor, ..self }
    }

    /// Adds a position fix.
    pub fn with_position_m(self, position_m: [f64; 3]) -> Self {
        Self { position_m, ..self }.and(valid::POSITION)
    }

    /// Adds the deviations of the position fix, by axis (m).
    pub fn with_position_std_m(self, position_std_m: [f64; 3]) -> Self {
        Self { position_std_m, ..self }
    }

    /// Adds the deviations of the velocity, by axis (m/s).
    pub fn with_velocity_std_m_s(self, velocity_std_m_s: [f64; 3]) -> Self {
        Self { velocity_std_m_s, ..self }
    }

    /// Adds the height of a position fix alone: a depth or an altitude, inertial (m).
    pub fn with_position_z_m(self, z_m: f64) -> Self {
        let absent = self.absent | absent::POSITION_X | absent::POSITION_Y;
        Self { position_m: [0.0, 0.0, z_m], absent, ..self }.and(valid::POSITION)
    }

    /// Adds an attitude fix.
    pub fn with_attitude_wxyz(self, attitude_wxyz: [f64; 4]) -> Self {
        Self { attitude_wxyz, ..self }.and(valid::ATTITUDE)
    }

    /// Adds a commanded force, inertial axes.
    pub fn with_force_n(self, force_n: [f64; 3]) -> Self {
        Self { force_n, force_frame: frame::INERTIAL, ..self }.and(valid::FORCE)
    }

    /// Adds a commanded force along the body axes.
    pub fn with_body_force_n(self, force_n: [f64; 3]) -> Self {
        Self { force_n, force_frame: frame::BODY, ..self }.and(valid::FORCE)
    }

    /// Adds a commanded torque, body axes.
    pub fn with_torque_n_m(self, torque_n_m: [f64; 3]) -> Self {
        Self { torque_n_m, ..self }.and(valid::TORQUE)
    }

    /// Adds the output of a general linear plant.
    ///
    /// # Panics
    /// With more than 6 numbers.
    pub fn with_output(mut self, output: &[f64]) -> Self {
        self.output[..output.len()].copy_from_slice(output);
        self.and(valid::OUTPUT)
    }

    /// Adds the commanded input of a general linear plant.
    ///
    /// # Panics
    /// With more than 6 numbers.
    pub fn with_input(mut self, input: &[f64]) -> Self {
        self.input[..input.len()].copy_from_slice(input);
        self.and(valid::INPUT)
    }

    /// Says that the vehicle stands on the ground.
    pub fn with_on_ground(self) -> Self {
        Self { flags: self.flags | flags::ON_GROUND, ..self }
    }

    /// Whether the vehicle says that it stands on the ground.
    pub fn is_on_ground(&self) -> bool {
        self.flags & flags::ON_GROUND != 0
    }

    /// The fields that carry what is measured or commanded, each with its place in the table.
    pub fn quantities() -> impl Iterator<Item = (usize, &'static Field, Quantity)> {
        let fields = Self::TABLE.fields.iter().enumerate();
        fields.filter_map(|(place, field)| Some((place, field, field.quantity?)))
    }

    /// The numbers of the field at a place in the table.
    pub fn numbers(&self, place: usize) -> &[f64] {
        match self.value(place) {
            Value::Numbers(numbers) => numbers,
            _ => &[],
        }
    }

    /// Adds these numbers as the field at a place in the table.
    ///
    /// # Panics
    /// Where the field has not as many.
    pub fn set(&mut self, place: usize, numbers: &[f64]) {
        self.numbers_mut(place).copy_from_slice(numbers);
        self.valid |= Self::TABLE.fields[place].valid;
    }

    /// Whether every value that is measured is a finite number.
    pub fn is_finite(&self) -> bool {
        numbers_are_finite(self, self.valid)
    }

    /// Whether all the given bits of [`valid`] are set.
    pub fn has(&self, bits: u32) -> bool {
        self.valid & bits == bits
    }
}
