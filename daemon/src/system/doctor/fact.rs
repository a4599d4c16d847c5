//! One fact about the machine, its verdict and its remedy; and the plan of what is measured.

use serde::Serialize;

/// What a fact means for the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing to do.
    Good,
    /// The service flies, but less punctually or safely than it could.
    CouldBeBetter,
    /// The service will be late or fail.
    Bad,
    /// The kernel does not tell.
    Unknown,
}

impl Verdict {
    /// In words.
    pub fn words(self) -> &'static str {
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
pub struct Fact {
    /// What it is about.
    pub name: &'static str,
    /// What was found.
    pub found: String,
    /// What that means.
    pub verdict: Verdict,
    /// The command or change that would help.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl Fact {
    pub(super) fn good(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Good, remedy: None }
    }

    pub(super) fn unknown(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Unknown, remedy: None }
    }

    pub(super) fn better(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::CouldBeBetter, remedy: Some(remedy.into()) }
    }

    pub(super) fn bad(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Bad, remedy: Some(remedy.into()) }
    }
}

/// What is measured.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Wake-ups per second.
    pub rate_hz: f64,
    /// Polled before each deadline (µs).
    pub spin_us: f64,
    /// Length of the measurement of each setting.
    pub seconds: f64,
    /// Of SCHED_FIFO.
    pub priority: u8,
    /// Of the measuring threads; `None`: any.
    pub cores: Option<Vec<usize>>,
}
