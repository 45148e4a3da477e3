//! Tests of several modules together.

mod grasps;
mod own_task;
