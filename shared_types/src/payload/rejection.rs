//! The reasons for which the gate rejects a sample.

use crate::table::Components;

macro_rules! rejections {
    ($($(#[doc = $doc:literal])+ $name:ident = $key:literal, $words:literal;)+) => {
        /// Why a sample was rejected; the value is its index in [`Counters::samples_rejected`].
        ///
        /// Where several reasons hold, one is counted: the first of `Overload`; `UnknownSensor`; `Malformed`; `NotFinite` in any field;
        /// `BeyondLimits` and `QuaternionNorm`, field by field in the order of the message; `FarFuture` and `TooOld`
        /// against the clock; `OtherSource`; the stamp and then the sequence against the newest accepted sample.
        ///
        /// [`Counters::samples_rejected`]: crate::payload::Counters::samples_rejected
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(C)]
        pub enum Rejection {
            $($(#[doc = $doc])+ $name,)+
        }

        /// The reasons as components of [`Counters::samples_rejected`](crate::payload::Counters::samples_rejected).
        pub(crate) const REASONS: Components = Components { name: "Rejected", names: &[$($key),+] };

        impl Rejection {
            /// All reasons, in the order of their values.
            pub const ALL: [Self; REASONS.names.len()] = [$(Self::$name),+];

            /// Their names, in that order, for files and other languages.
            pub const KEYS: [&str; REASONS.names.len()] = [$($key),+];

            /// The reason in words.
            pub fn words(self) -> &'static str {
                match self {
                    $(Self::$name => $words,)+
                }
            }

            /// What the reason says at length.
            pub fn doc(self) -> &'static str {
                match self {
                    $(Self::$name => concat!($($doc),+),)+
                }
            }
        }
    };
}

rejections! {
    /// A valid field is NaN or infinite.
    NotFinite = "not_finite", "not finite";
    /// A valid field is beyond the configured physical limit.
    BeyondLimits = "beyond_limits", "beyond physical limits";
    /// The attitude is not of unit norm.
    QuaternionNorm = "quaternion_norm", "quaternion not of unit norm";
    /// The source has already told a field of this instant.
    RepeatedStamp = "repeated_stamp", "repeated stamp";
    /// The stamp lies before the window in which late samples are put where they belong (`input.max_age_s`), or, with a law that cannot go back, before the newest one.
    TooLate = "too_late", "too late";
    /// The stamp lies too far behind the clock.
    TooOld = "too_old", "too far behind the clock";
    /// The stamp lies too far ahead of the clock.
    FarFuture = "far_future", "too far ahead of the clock";
    /// The sequence went backwards although the source is the same.
    SequenceBackwards = "sequence_backwards", "sequence went backwards";
    /// Another source holds the stream, or there are too many.
    OtherSource = "other_source", "another source holds the stream";
    /// No valid field, an unknown bit of `valid`, `flags` or `absent`, a body velocity or a specific force without one of its components, or an unknown frame.
    Malformed = "malformed", "malformed";
    /// The configuration has `[[sensor]]` tables, and none with the sample's number.
    UnknownSensor = "unknown_sensor", "unknown sensor";
    /// The loop was late for too long to use it.
    Overload = "overload", "the loop was late";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rejection_has_its_own_counter() {
        for (index, reason) in Rejection::ALL.into_iter().enumerate() {
            assert_eq!(reason as usize, index, "{}", reason.words());
        }
    }
}
