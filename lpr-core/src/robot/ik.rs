//! Inverse kinematics.
