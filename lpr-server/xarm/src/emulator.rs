//! An emulator of the controller that runs in real time and that the vendor's own SDK can drive.
//!
//! `controller` is a pure state machine; `server` gives it sockets and the time of day. Both know
//! the arm only through a [`World`]: the [`KinematicWorld`] moves exactly as it is told, and
//! nothing is in its way.

mod controller;
mod fault;
mod gripper;
mod listen;
mod motion;
mod received;
mod server;
mod settings;
mod socket;
mod world;

pub use fault::{Fault, FaultKind};
pub use listen::EmulatorError;
pub use received::{Channel, Received};
pub use server::Emulator;
pub use settings::EmulatorSettings;
pub use world::{Fingers, KinematicWorld, Setpoint, World};
