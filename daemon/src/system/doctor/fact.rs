//! The type of a fact about the machine, with verdict and remedy; and the plan of the measurements.

use serde::Serialize;

/// The verdict on a fact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Verdict {
    Good,
    /// The service works, but less punctually or safely than it could.
    CouldBeBetter,
    /// The service will be late or fail.
    Bad,
    /// The kernel does not report it.
    Unknown,
}

impl Verdict {
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::CouldBeBetter => "could be better",
            Self::Bad => "bad",
            Self::Unknown => "unknown",
        }
    }
}

/// One thing that punctuality or safety depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Fact {
    pub(crate) name: &'static str,
    pub(crate) found: String,
    pub(crate) verdict: Verdict,
    /// The command or change that would help.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) remedy: Option<String>,
}

impl Fact {
    pub(crate) fn good(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Good, remedy: None }
    }

    pub(crate) fn unknown(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Unknown, remedy: None }
    }

    pub(crate) fn better(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::CouldBeBetter, remedy: Some(remedy.into()) }
    }

    pub(crate) fn bad(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Bad, remedy: Some(remedy.into()) }
    }
}

/// What is measured.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) rate_hz: f64,
    /// Polled before each deadline (µs).
    pub(crate) spin_us: f64,
    /// Length of the measurement of each setting.
    pub(crate) seconds: f64,
    pub(crate) priority: u8,
    /// Of the measuring threads; `None`: any.
    pub(crate) cores: Option<Vec<usize>>,
}
