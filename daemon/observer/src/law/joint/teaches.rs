//! What a sample may teach.

/// What may be learned from a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Teaches {
    /// The weights, too.
    All,
    /// The state alone: the weights and their variance stay as they are.
    State,
}
