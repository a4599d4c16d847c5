//! The root of the configuration, and the tables that do not belong to a channel: initial state, input, deadlines, snapshots.

use crate::channels::{CommonKeys, LawKeys, LinearConfig, RotationConfig, TranslationConfig};
use crate::real_time::RealTimeConfig;
use crate::sensors::SensorConfig;
use crate::values::{LawName, OutlierAction};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// When the service steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Trigger {
    /// At every tick of `rate_hz`.
    #[default]
    Timer,
    /// As soon as a sample arrives, polling one core; at `rate_hz` while none does.
    Sample,
}

/// What time it is for the estimate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// CLOCK_MONOTONIC: the estimate is propagated from the newest sample to the tick.
    #[default]
    Monotonic,
    /// The stamp of the newest sample: for replay at another speed than that of the flight.
    Samples,
}

/// Which sources are used where several publish.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SourcePolicy {
    /// All of them: each with a sequence of its own, fused in the order of their stamps.
    #[default]
    All,
    /// The one in use, until it has been silent for `takeover_after_s`.
    First,
    /// The one that appeared last.
    Newest,
}

/// The whole configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("anyOf" = [
    { "required": ["translation"] },
    { "required": ["rotation"] },
    { "required": ["linear"] },
]))]
pub struct Config {
    /// Ticks per second; each publishes one estimate.
    ///
    /// Not below the rate of the fastest sensor; more costs processor time, not accuracy, and shortens what a
    /// controller waits. Also as --rate-hz.
    #[schemars(range(min = 1.0, max = 10000.0), example = 200.0)]
    pub rate_hz: f64,
    /// When to step: "timer" at rate_hz, or "sample" as soon as one arrives (polls one core).
    ///
    /// Change it where microseconds between sample and estimate matter and a core is free for them.
    #[serde(default)]
    pub trigger: Trigger,
    /// Time of the estimate: "monotonic" (now), or "samples" (stamp of the newest sample; replay at another
    /// speed).
    ///
    /// "monotonic" for everything that flies.
    #[serde(default)]
    pub clock: Clock,
    /// The last microseconds of every wait are spent polling the clock: less lateness for more of a core.
    ///
    /// 200 takes most of the wake-up lateness away for 4 % of a core at 200 Hz; `bench jitter` measures both.
    /// 0 never polls, and at most it is the period of rate_hz.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub spin_us: f64,
    /// When a configured channel has no output for this long, the estimate's status says stale, and which channel.
    ///
    /// As long as your controller may fly on a prediction. Only the status changes: channels coast much
    /// earlier. A channel without any output yet is stale, too: configure those that are measured.
    #[serde(default = "stale_after_s")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub stale_after_s: f64,
    /// The state before the first sample; what is missing is taken from the first measurement of it.
    #[serde(default, skip_serializing_if = "InitialConfig::is_empty")]
    pub initial: InitialConfig,
    /// Which samples are accepted, and from which source.
    #[serde(default)]
    pub input: InputConfig,
    /// Sensors with a mounting, noise or latency of their own, for the samples that carry their numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensor: Vec<SensorConfig>,
    /// What happens when several ticks in a row end after their next deadline.
    #[serde(default)]
    pub deadline: DeadlineConfig,
    /// What is written down, so that nothing learned is lost.
    #[serde(default)]
    pub snapshot: SnapshotConfig,
    /// What the loop asks of the system, also `priority = 1 … 98` and `cores = [2]`. What the system refuses is
    /// logged, and the service runs without it (daemon doctor).
    #[serde(default)]
    pub real_time: RealTimeConfig,
    /// Position, velocity and unknown force from measured velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translation: Option<TranslationConfig>,
    /// Attitude, angular velocity and unknown torque from measured angular velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<RotationConfig>,
    /// A general linear plant x' = A x + B (u + f(y)), y = C x, in units of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linear: Option<LinearConfig>,
}

impl Config {
    /// d of translation (m/s), rotation (rad/s), linear plant (its output's unit); 0 where there is no such channel, and where
    /// its law has no dead zone.
    pub fn dead_zone_width(&self) -> [f64; 3] {
        let translation = self.translation.as_ref().map(TranslationConfig::common);
        let rotation = self.rotation.as_ref().map(RotationConfig::common);
        let linear = self.linear.as_ref().map(LinearConfig::common);
        let of_gradient =
            |keys: CommonKeys<'_>| keys.dead_zone_width.filter(|_| keys.law == LawName::Gradient);
        [translation, rotation, linear].map(|keys| keys.and_then(of_gradient).unwrap_or_default())
    }

    /// The law of each channel that there is, with the keys of the joint and of the gradient law.
    pub fn laws(&self) -> impl Iterator<Item = (&'static str, LawName, [LawKeys; 2])> {
        let translation = self.translation.as_ref().map(TranslationConfig::law);
        let rotation = self.rotation.as_ref().map(RotationConfig::law);
        let linear = self.linear.as_ref().map(LinearConfig::law);
        [
            translation.map(|law| ("translation", law, TranslationConfig::LAWS)),
            rotation.map(|law| ("rotation", law, RotationConfig::LAWS)),
            linear.map(|law| ("linear", law, LinearConfig::LAWS)),
        ]
        .into_iter()
        .flatten()
    }

    /// The keys, `table.key`, that the channels' laws do not have.
    pub fn keys_of_other_laws(&self) -> Vec<String> {
        let foreign = |(table, law, [joint, gradient]): (_, LawName, [LawKeys; 2])| {
            let (own, other) = if law == LawName::Joint { (joint, gradient) } else { (gradient, joint) };
            other.without(own).map(move |key| format!("{table}.{key}"))
        };
        self.laws().flat_map(foreign).collect()
    }

    /// The configuration as a document, without the keys that the channels' laws do not have: reading it gives the same
    /// configuration.
    pub fn document(&self) -> toml::Table {
        let mut document = toml::Table::try_from(self).expect("a configuration is a TOML document");
        for key in self.keys_of_other_laws() {
            if let Some((table, key)) = key.split_once('.')
                && let Some(toml::Value::Table(table)) = document.get_mut(table)
            {
                table.remove(key);
            }
        }
        document
    }
}

/// The state before the first sample; what is missing is taken from the first measurement of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitialConfig {
    /// Position, inertial.
    ///
    /// Set it where there are no position fixes; otherwise the dead-reckoned position starts from the origin.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = vec![0.0, 0.0, -10.0])]
    pub position_m: Option<[f64; 3]>,
    /// Velocity, inertial.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = vec![0.0, 0.0, 0.0])]
    pub velocity_m_s: Option<[f64; 3]>,
    /// Attitude, unit quaternion, body to inertial.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = vec![1.0, 0.0, 0.0, 0.0])]
    pub attitude_wxyz: Option<[f64; 4]>,
    /// Angular velocity, body axes.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = vec![0.0, 0.0, 0.1])]
    pub angular_velocity_rad_s: Option<[f64; 3]>,
}

impl InitialConfig {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// Which samples are accepted, and from which source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InputConfig {
    /// A faster measured velocity is rejected; a faster estimate is reset.
    ///
    /// Above what your vehicle can reach, wind included, but well below what a broken sensor says.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_speed_m_s: f64,
    /// A faster measured rotation is rejected; a faster estimate is reset.
    ///
    /// Above what your vehicle can reach, below the range of the gyroscope.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_angular_rate_rad_s: f64,
    /// A larger measured specific force is rejected.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_specific_force_m_s2: f64,
    /// A position further from the origin is rejected; such an estimate is reset.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_position_m: f64,
    /// A larger commanded force is rejected.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_force_n: f64,
    /// A larger commanded torque is rejected.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_torque_n_m: f64,
    /// With a larger learned force the translation is reset to its last checkpoint.
    ///
    /// A few times the largest disturbance that you expect, for example the vehicle's weight. This limit stops
    /// a learner that diverges.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_unknown_force_n: f64,
    /// With a larger learned torque the rotation is reset to its last checkpoint.
    ///
    /// A few times the largest torque that you expect.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_unknown_torque_n_m: f64,
    /// An output of the linear plant with a larger entry is rejected.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_output: f64,
    /// A commanded input of the linear plant with a larger entry is rejected; a learned one is reset.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_input: f64,
    /// With a larger entry of its state the linear plant is reset to its last checkpoint.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_state: f64,
    /// A stamp further ahead of the clock is rejected.
    ///
    /// Stamps are CLOCK_MONOTONIC of this machine: raise it only for sources whose clock is another one.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_future_s: f64,
    /// A stamp further behind the clock, or behind the newest sample, is rejected. One that is not so late is put where it
    /// belongs, and what came after it is done again.
    ///
    /// More than the largest delay of your slowest sensor: 1.5 with a USBL whose fixes come after one second. A longer window
    /// costs memory, and time only where samples are as late as that.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_age_s: f64,
    /// Where several publish: "all" uses all of them, "first" keeps the one in use, "newest" takes the one that appeared last.
    ///
    /// "all" where each sensor has a process of its own. "first" and "newest" where redundant copies of one process
    /// publish the same readings, which must not count twice.
    pub source: SourcePolicy,
    /// A source silent for this long may be replaced by another one, and may begin its sequence anew.
    ///
    /// Some periods of the source: shorter than the outage that your vehicle stands, longer than its jitter.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub takeover_after_s: f64,
    /// What happens to an outlier, an output with an unusually large error: "off" uses it, "adaptation" does not learn
    /// from it, "correction" does not use it. A change that lasts longer than 10 holds is accepted.
    ///
    /// "off" is the paper's observer. With "correction" a spike does not reach the estimate, and a real jump
    /// does a few samples later.
    pub outliers: OutlierAction,
    /// An output is an outlier if its error is this many times the dead zone's width plus the running scale of the
    /// errors.
    ///
    /// A lower factor finds smaller spikes and rejects more good outputs.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub outlier_factor: f64,
    /// What happens to the outputs of a sensor that repeats one value to the bit: "off" uses them, "adaptation"
    /// does not learn from them, "correction" does not use them. The log names the sensor.
    ///
    /// "off" for sensors that repeat themselves by nature: coarsely quantised, or simulated without noise. With "correction" the
    /// joint law does not use a repeated reading, from the first repetition on, once it disagrees with the prediction by five
    /// deviations and until it changes: for a Doppler log that sends zeros without bottom lock. Not for a vehicle that stands on the ground
    /// without saying so (ON_GROUND): a reading of zero there is true, and the model, which has no ground, denies it.
    pub stuck: OutlierAction,
    /// Repetitions of one value after which a sensor is stuck; 0 is never.
    pub stuck_after_samples: u64,
}

/// What happens when several ticks in a row end after their next deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DeadlineConfig {
    /// After this many late ticks in a row the estimate's status says late; 0 is never.
    pub warn_after_ticks: u64,
    /// After this many late ticks in a row samples are not used until a tick is in time again; 0 is never.
    ///
    /// Ticks without samples are cheaper, so that a service on an overloaded machine is in time again.
    pub predict_only_after_ticks: u64,
    /// After this many late ticks in a row the estimate's status says invalid, not to be used; 0 is never.
    pub invalid_after_ticks: u64,
}

impl Default for DeadlineConfig {
    fn default() -> Self {
        Self { warn_after_ticks: 1, predict_only_after_ticks: 10, invalid_after_ticks: 50 }
    }
}

/// What is written down, so that nothing learned is lost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SnapshotConfig {
    /// Time between two snapshots; 0 writes one on command and at the end only.
    ///
    /// What is lost at most when the machine loses power. The disk is written by a thread of its own.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub save_every_s: f64,
    /// After a restart the service resumes the state of a snapshot that is not older than this. What was learned
    /// is always resumed.
    ///
    /// As long as your vehicle stays near where it was while the service is away.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub resume_state_within_s: f64,
}

impl Default for SnapshotConfig {
    fn default() -> Self {
        Self { save_every_s: 5.0, resume_state_within_s: 10.0 }
    }
}

impl Default for InputConfig {
    fn default() -> Self {
        Self {
            max_speed_m_s: 100.0,
            max_angular_rate_rad_s: 50.0,
            max_specific_force_m_s2: 1e3,
            max_position_m: 1e6,
            max_force_n: 1e5,
            max_torque_n_m: 1e5,
            max_unknown_force_n: 1e5,
            max_unknown_torque_n_m: 1e5,
            max_output: 1e9,
            max_input: 1e9,
            max_state: 1e9,
            max_future_s: 0.05,
            max_age_s: 0.5,
            source: SourcePolicy::All,
            takeover_after_s: 0.2,
            outliers: OutlierAction::Correction,
            outlier_factor: 8.0,
            stuck: OutlierAction::Adaptation,
            stuck_after_samples: 50,
        }
    }
}

fn stale_after_s() -> f64 {
    0.5
}
