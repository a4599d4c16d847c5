//! What is proven for a design: certificate, design report, box search. Computed at set-up, not in a step.

pub(crate) mod box_search;
pub(crate) mod certificate;
pub(crate) mod cover;
pub(crate) mod design_report;
pub(crate) mod findings;
pub(crate) mod joint_report;
pub(crate) mod lure_pair;
pub(crate) mod words;
