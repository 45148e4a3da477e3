//! Objects that several tasks are about.

pub(super) mod cardboard_box;
pub(super) mod chest;
pub(super) mod grill;
pub(super) mod toilet;
