//! Which of several sensors a reading comes from, and what becomes of its outliers.

/// As many sensors have noise levels of their own; see [`SensorUse::place`].
pub const MAX_SENSORS: usize = 16;

/// What becomes of a reading that disagrees with the prediction, ζ > 4.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Outliers {
    /// It counts as a noisier one: S_w = S ζ/4.
    #[default]
    Weigh,
    /// It is not used.
    Reject,
    /// It counts as any other.
    Off,
}

/// The sensor of a reading.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SensorUse {
    /// Which noise level is its own: below [`MAX_SENSORS`].
    pub place: usize,
    /// What becomes of its outliers.
    pub outliers: Outliers,
    /// Whether the deviation of the reading bounds an error that is not noise: the sensor's noise level does not follow it, and
    /// makes it larger only.
    pub is_bounded: bool,
}
