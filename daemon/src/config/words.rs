//! Words of the configuration that are types of `observer`, which knows of no schema.

use schemars::JsonSchema;

/// What happens to an output that is not believed; stands for [`observer::Doubt`] in the schema.
#[derive(JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub(super) enum Doubt {
    /// It is believed, as in the paper.
    Off,
    /// It corrects the state, but nothing is learned from it.
    Adaptation,
    /// It is not used at all: the channel holds the output before, then coasts.
    Correction,
}

/// One that is new there must be added here.
#[allow(dead_code)]
fn all_are_here(doubt: observer::Doubt) -> Doubt {
    match doubt {
        observer::Doubt::Off => Doubt::Off,
        observer::Doubt::Adaptation => Doubt::Adaptation,
        observer::Doubt::Correction => Doubt::Correction,
    }
}
