//! §2: samples that disagree with the prediction, one by one or several in a row.

use serde::{Deserialize, Serialize};

/// ζ beyond this is a stray sample.
pub(crate) const STRAY: f64 = 4.0;
/// After more stray samples in a row than this, the vehicle does something new.
const MAX_STRAY_SAMPLES: u32 = 3;

/// Stray samples in a row.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct StraySamples(u32);

impl StraySamples {
    /// Counts a sample with this ζ²; whether there are too many in a row to be stray.
    pub(crate) fn count(&mut self, nis: f64) -> bool {
        self.0 = if nis > STRAY * STRAY { self.0.saturating_add(1) } else { 0 };
        self.0 > MAX_STRAY_SAMPLES
    }
}
