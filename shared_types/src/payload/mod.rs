//! The messages: `#[repr(C)]`, fixed size, no padding, SI units. A message with another layout has another type name.
//!
//! Frames: I is inertial, J the body, both right-handed; `attitude_wxyz` rotates body vectors into I.
//!
//! Each file holds the tables of some payloads; [`crate::table`] describes tables. To add a field or a counter, add its row,
//! increase the version in the type names of the payloads that hold it, and generate the files of the other languages:
//!
//! ```text
//! UPDATE=1 cargo test -p observer_client --test generated
//! ```

mod estimate;
mod layout;
mod measurement;
mod rejection;
mod status;
mod truth;

pub use estimate::{Channel, Estimate, status_bits};
pub use layout::{CONSTANTS, PAYLOADS};
pub use measurement::{
    MAX_SEQUENCE_GAP, Measurement, QUATERNION_NORM_TOLERANCE, absent, flags, frame, valid,
};
pub use rejection::Rejection;
pub use status::{
    Command, Counters, LatencySummary, Reply, SourceStatus, Status, command, outcome, real_time, restored,
};
pub use truth::Truth;
