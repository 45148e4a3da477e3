//! A UFACTORY xArm7: everything between a path and the arm that drives it.
//!
//! Who audits what moves hardware reads and builds this crate alone: on top of the planning half of
//! [`lpr_core`] it has threads and sockets of the standard library, and neither networks, simulator,
//! web server nor async runtime.
//!
//! A path becomes motion in one way only: [`schedule`](mod@schedule) gives it times,
//! [`safety::check_path`] makes the only value that [`executor::Link::execute`] takes, and whatever
//! goes wrong while that is sent stops the arm for good. [`client::Client`] sends any request that
//! it is given; the executor alone gives it one that enables or moves anything. Stopping the arm by
//! a command is no safety-rated stop: the emergency button is.
//!
//! # Modules, in reading order
//!
//! 1. [`wire`]: frames, requests, replies and reports as bytes, both directions; the only place with
//!    millimetres, and it has no socket.
//! 2. [`client`]: one owner of a socket for commands, one reader of reports.
//! 3. [`schedule`](mod@schedule): a time for every point of a path, slow at its corners.
//! 4. [`safety`]: the rules that a whole timed path keeps before the first frame is sent.
//! 5. [`executor`]: the stream of points, and the watch on the arm while it runs.
//! 6. [`emulator`]: a controller in real time, for tests and for the vendor's own SDK; its
//!    [`World`](emulator::World) says how arm and fingers answer.
//! 7. [`point_to_point`](mod@point_to_point): motions of the fastest kind between two states, for
//!    motions that a controller queues.
//!
//! # Building it alone
//!
//! ```sh
//! cargo build --locked -p lpr-xarm
//! cargo test --locked -p lpr-xarm
//! cargo tree --locked -p lpr-xarm --edges normal,build
//! ```
//!
//! # Units
//!
//! Metres, radians, seconds; the world is the base of the arm, z up.

pub mod client;
pub mod emulator;
pub mod executor;
pub mod point_to_point;
mod ports;
pub mod safety;
pub mod schedule;
pub mod wire;

pub use ports::Ports;
