//! Words of the configuration that are types of `observer`, which knows of no schema.

use schemars::JsonSchema;

/// What happens to an output that is not accepted; stands for [`observer::OutlierAction`] in the schema.
#[derive(JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub(super) enum OutlierAction {
    /// It is believed, as in the paper.
    Off,
    /// It corrects the state, but nothing is learned from it.
    Adaptation,
    /// It is not used at all: the channel holds the output before, then coasts.
    Correction,
}

/// One that is new there must be added here.
#[allow(dead_code)]
fn all_are_here(action: observer::OutlierAction) -> OutlierAction {
    match action {
        observer::OutlierAction::Off => OutlierAction::Off,
        observer::OutlierAction::Adaptation => OutlierAction::Adaptation,
        observer::OutlierAction::Correction => OutlierAction::Correction,
    }
}
