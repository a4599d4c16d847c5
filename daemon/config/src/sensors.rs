//! `[[sensor]]`: where a sensor sits, how it errs, how late it stamps.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The largest number of a sensor.
pub const MAX_SENSOR: u32 = 15;

/// What happens to a reading that disagrees with the prediction by more than four deviations.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OutlierWeight {
    /// It counts as a noisier one; after three in a row it is believed, the vehicle does something new.
    #[default]
    Weigh,
    /// It is not used; after three in a row it is believed.
    Reject,
    /// It counts as any other.
    Off,
}

/// What a sensor's stamps are read from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SensorClock {
    /// `CLOCK_MONOTONIC` of this machine.
    #[default]
    Monotonic,
    /// `CLOCK_REALTIME` of this machine, the time of day in nanoseconds since 1970.
    Realtime,
    /// Another clock. Its offset is the least of arrival minus stamp over the last one to two minutes: a reading that came the
    /// shortest way counts as taken when it arrived. `latency_s` takes that way off.
    Own,
}

/// One sensor, for the samples that carry its number. Where there is any such table, samples of another number than 0 and these
/// are rejected. Noises are those of samples without deviations of their own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorConfig {
    /// Its name in messages.
    #[schemars(example = &"dvl")]
    pub name: String,
    /// `sensor` of its samples; each number once.
    #[schemars(range(min = 1, max = 15), example = 1)]
    pub number: u32,
    /// Where it sits, from the center of mass, body axes. Its velocities and positions are turned into those of the center of
    /// mass with the estimated attitude and angular velocity, which needs `[rotation]`.
    ///
    /// A Doppler log a meter before the center of mass of a vehicle that turns at 0.2 rad/s measures 0.2 m/s of sway.
    #[serde(default)]
    pub lever_arm_m: [f64; 3],
    /// How it is mounted: unit quaternion that turns its axes into the body's.
    ///
    /// It turns velocities in body axes, angular velocities, specific forces and attitudes.
    #[serde(default = "identity")]
    pub mounting_wxyz: [f64; 4],
    /// 1 σ of its velocity, each component; 0: that of the channel.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub velocity_noise_m_s: f64,
    /// 1 σ of its angular velocity, each component; 0: that of the channel.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub angular_velocity_noise_rad_s: f64,
    /// 1 σ of its specific force, each component; 0: that of the channel, which must have one.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub specific_force_noise_m_s2: f64,
    /// 1 σ of its position, each component; 0: that of the channel.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub position_noise_m: f64,
    /// 1 σ of its attitude, each component of the rotation vector; 0: that of the channel.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub attitude_noise_rad: f64,
    /// How much older a reading is than its stamp: subtracted from the stamp.
    ///
    /// For drivers that stamp on arrival: the sensor's own delay and that of the line. `bench tune FILE --sensor 1` finds that of sensor 1 where there is an accelerometer.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 60.0))]
    pub latency_s: f64,
    /// The clock of its stamps. The offset of another one than `"monotonic"` is logged. One sensor number for each such clock.
    #[serde(default)]
    pub clock: SensorClock,
    /// Samples per second that it should give; 0: not known. Silence for three periods is logged.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub rate_hz: f64,
    /// What the joint law does with a reading that disagrees with the prediction by more than four deviations.
    #[serde(default)]
    pub outliers: OutlierWeight,
}

fn identity() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}
