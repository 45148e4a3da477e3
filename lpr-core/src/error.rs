//! The one error type: broken input. A path that cannot be found is a [`crate::path::Rejection`],
//! never an error.

use thiserror::Error;

/// Broken input, with the value at fault and what would be right.
///
/// ```
/// use lpr_core::Error;
/// use lpr_core::robot::Robot;
///
/// let error = Robot::by_name("ur5").unwrap_err();
/// assert!(matches!(&error, Error::Robot(message) if message.contains("xarm7")), "it names what there is");
/// assert!(error.to_string().starts_with("robot: "));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting that does not parse or lies outside its range.
    #[error("configuration: {0}")]
    Config(String),
    /// A checkpoint that is corrupt, foreign or newer than this program.
    #[error("checkpoint: {0}")]
    Checkpoint(String),
    /// A snapshot of a world that is corrupt, foreign or of another version.
    #[error("snapshot: {0}")]
    Snapshot(String),
    /// A tensor, path or image of another shape than asked for.
    #[error("{what}: expected shape {expected}, found {found}")]
    Shape {
        /// The thing that was being read.
        what: &'static str,
        /// The shape asked for.
        expected: String,
        /// The shape found.
        found: String,
    },
    /// An unknown robot, or one whose description contradicts itself.
    #[error("robot: {0}")]
    Robot(String),
    /// An unknown task, a scene that cannot be built or placed.
    #[error("environment: {0}")]
    Environment(String),
    /// A network whose answers are no numbers: it diverged in training.
    #[error("{network}: its answers are not numbers, found {found}")]
    NotFinite {
        /// The network.
        network: &'static str,
        /// The first of them that is none.
        found: String,
    },
    /// A network that does not learn any more: its numbers are none, or grow without bound.
    #[error(
        "{network}: diverged in update {update}: {found}; batch of rows {rows:?} of the replay"
    )]
    Diverged {
        /// The network.
        network: &'static str,
        /// Its updates before this one.
        update: u64,
        /// The number at fault.
        found: String,
        /// Rows of the replay that the update learned from, by their numbers.
        rows: Vec<u64>,
    },
    /// A camera or an arm that failed.
    #[error(transparent)]
    Fault(#[from] Fault),
}

/// Failure of a world that is not the agent's doing.
///
/// ```
/// use lpr_core::Error;
/// use lpr_core::env::Fault;
///
/// let gone = Fault::Camera { camera: "front".to_owned(), reason: "no frame for 2 s".to_owned() };
/// assert_eq!(Error::from(gone).to_string(), "camera front: no frame for 2 s");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Fault {
    /// A camera gives no image.
    #[error("camera {camera}: {reason}")]
    Camera {
        /// Name of the camera.
        camera: String,
        /// The reason, for reading.
        reason: String,
    },
    /// The arm has stopped for good, or does not answer.
    #[error("arm: {reason}")]
    Arm {
        /// The reason, for reading.
        reason: String,
    },
}

/// Result with this crate's [`enum@Error`].
pub type Result<T, E = Error> = core::result::Result<T, E>;
