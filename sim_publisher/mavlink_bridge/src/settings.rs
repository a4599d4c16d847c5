//! The settings of a bridge: which messages it uses, and how.

/// Which messages are taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Source {
    /// ODOMETRY if it arrives, otherwise the others.
    #[default]
    Auto,
    /// ODOMETRY alone.
    Odometry,
    /// LOCAL_POSITION_NED with ATTITUDE_QUATERNION or ATTITUDE.
    LocalPosition,
}

/// The settings of a bridge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The vehicle; `None` for the first autopilot from which a message arrives.
    pub system_id: Option<u8>,
    /// Its component.
    pub component_id: u8,
    /// Which messages.
    pub source: Source,
    /// Times that differ by no more than this are one sample (ns).
    pub join_ns: u64,
    /// Force of a thrust set-point of 1 (N).
    pub thrust_n: Option<f64>,
    /// Torque of a torque set-point of 1 (N·m), about each axis of the body.
    pub torque_n_m: Option<[f64; 3]>,
    /// The rate at which the vehicle is requested to send the messages (Hz).
    pub request_rate_hz: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            system_id: None,
            component_id: 1,
            source: Source::Auto,
            join_ns: 5_000_000,
            thrust_n: None,
            torque_n_m: None,
            request_rate_hz: None,
        }
    }
}
