//! What is seen of a world: by the cameras of an observation, and by any camera in the channels
//! that are asked for.

use super::env::SimEnvironment;
use super::randomization::{Sensing, noise_stream};
use super::render::{Capture, Channel, Detail, Item, MeshId, NO_ITEM, Renderer};
use super::world::World;
use crate::error::Result;
use crate::perception::{CAMERA_NAMES, Camera, View};
use crate::scene::Part;
use glamx::Pose3;

/// What one camera is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRequest {
    /// Name of [`Camera::by_name`].
    pub camera: String,
    /// Columns and rows, pixels; the vertical field of view is the same for every size.
    pub size: [usize; 2],
    /// What is made of the image; nothing else is.
    pub channels: Vec<Channel>,
}

/// What a value of a mask stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen<'a> {
    /// Nothing.
    Nothing,
    /// A body of the scene.
    Body {
        /// Its index in the scene.
        body: usize,
        /// Its name.
        name: &'a str,
    },
    /// A link, the hand or a finger.
    Robot {
        /// Its name.
        part: &'static str,
    },
}

/// Meshes and colours of the scene, made once an episode, and how its cameras see it.
#[derive(Debug, Clone)]
pub(super) struct Drawing {
    renderer: Renderer,
    /// Parts of each body of the scene, then of each frame of the robot.
    bodies: Vec<Vec<DrawnPart>>,
    sensing: Option<SeededSensing>,
}

#[derive(Debug, Clone)]
struct DrawnPart {
    mesh: MeshId,
    body_from_part: Pose3,
    rgb: [u8; 3],
}

#[derive(Debug, Clone)]
struct SeededSensing {
    settings: Sensing,
    seed: u64,
}

impl World {
    /// What `value` of a mask of this world stands for: 0 nothing, then 1 + the index of a body,
    /// then the frames of the robot (base to link 7, hand, both fingers). `None` for a value that
    /// is in no mask.
    #[must_use]
    pub fn seen_in_mask(&self, value: u16) -> Option<Seen<'_>> {
        let Some(idx) = usize::from(value).checked_sub(1) else { return Some(Seen::Nothing) };
        let bodies = &self.spec().bodies;
        match bodies.get(idx) {
            Some(body) => Some(Seen::Body { body: idx, name: &body.name }),
            None => {
                Self::robot_body_names().get(idx - bodies.len()).map(|part| Seen::Robot { part })
            }
        }
    }
}

impl SimEnvironment {
    /// Cameras measure with noise, and the scene looks otherwise, from now on: the same `seed`
    /// looks the same.
    ///
    /// [`crate::env::Environment::reset`] keeps the settings and takes the scene's seed.
    pub fn set_sensing(&mut self, settings: Sensing, seed: u64) {
        self.drawing.set_sensing(&self.world, settings, seed);
    }

    /// How cameras measure and the scene looks, if that was ever set.
    #[must_use]
    pub fn sensing(&self) -> Option<&Sensing> {
        self.drawing.sensing.as_ref().map(|sensing| &sensing.settings)
    }

    /// What built-in cameras see now, each in its channels and size. The scene's own cameras are
    /// not asked.
    ///
    /// # Errors
    ///
    /// When a camera is unknown, naming those that exist.
    pub fn frames(&mut self, requests: &[CameraRequest]) -> Result<Vec<Capture>> {
        let world_from_flange = self.world_from_flange();
        let frame = |CameraRequest { camera, size: [width, height], channels }: &CameraRequest| {
            let camera = Camera::by_name(camera, &self.robot, &world_from_flange)?
                .with_size(*width, *height);
            Ok(self.frame(camera, channels))
        };
        requests.iter().map(frame).collect()
    }

    /// What a camera that stands anywhere sees now.
    #[must_use]
    pub fn frame(&mut self, camera: Camera, channels: &[Channel]) -> Capture {
        let items = self.drawing.items(&self.world);
        self.drawing.capture(camera, &items, channels, self.step)
    }

    /// What an agent gets of a built-in camera.
    pub(super) fn view(&mut self, name: &str) -> View {
        /// Everything but the mask.
        const SEEN: [Channel; 3] = [Channel::Rgb, Channel::Depth, Channel::Cloud];
        let world_from_flange = self.world_from_flange();
        let camera = Camera::by_name(name, &self.robot, &world_from_flange)
            .expect("camera names were checked at construction");
        if self.drawing.sensing.is_none() {
            // In one pass over the pixels.
            let items = self.drawing.items(&self.world);
            return self.drawing.renderer.render(&camera, &items).view;
        }
        let Capture { camera, rgb, depth, points, .. } = self.frame(camera, &SEEN);
        let asked = "a channel that was asked for is there";
        View {
            camera,
            rgb: rgb.expect(asked),
            depth: depth.expect(asked),
            points: points.expect(asked),
        }
    }

    fn world_from_flange(&self) -> Pose3 {
        Pose3::from(self.robot.flange(self.world.config()))
    }

    /// Items of a picture: every visible part of scene and robot. Ids are 1 + body index, then the
    /// robot's frames.
    ///
    /// # Errors
    ///
    /// When a shape has no volume.
    pub fn picture_items(world: &World, renderer: &mut Renderer) -> Result<Vec<Item>> {
        Ok(items(world, &meshes(world, renderer)?))
    }
}

impl Drawing {
    pub(super) fn new(world: &World) -> Result<Self> {
        let mut renderer = Renderer::new(Detail::Observation);
        let bodies = meshes(world, &mut renderer)?;
        Ok(Self { renderer, bodies, sensing: None })
    }

    fn set_sensing(&mut self, world: &World, settings: Sensing, seed: u64) {
        let randomization = &settings.randomization;
        self.renderer.light = randomization.light(seed);
        let n_bodies = world.spec().bodies.len();
        let built = world.scene_items().map(|(_, _, parts)| parts.to_vec());
        let built = built.chain(world.robot_items().into_iter().map(|(_, parts)| parts));
        for (idx, (drawn, built)) in self.bodies.iter_mut().zip(built).enumerate() {
            let shift = randomization.color_shift(seed, idx.min(n_bodies));
            for (drawn, part) in drawn.iter_mut().zip(built) {
                // Casts saturate.
                drawn.rgb = core::array::from_fn(|c| (f32::from(part.rgb[c]) + shift[c]) as u8);
            }
        }
        self.sensing = Some(SeededSensing { settings, seed });
    }

    fn items(&self, world: &World) -> Vec<Item> {
        items(world, &self.bodies)
    }

    fn capture(
        &mut self,
        camera: Camera,
        items: &[Item],
        channels: &[Channel],
        step: usize,
    ) -> Capture {
        let Some(SeededSensing { settings: Sensing { noise, randomization }, seed }) =
            &self.sensing
        else {
            return self.renderer.capture(&camera, items, channels, |_| {});
        };
        let known = CAMERA_NAMES.iter().position(|name| *name == camera.name);
        let camera_idx = known.unwrap_or(CAMERA_NAMES.len()) as u64;
        let camera = randomization.moved(*seed, camera_idx, camera);
        let measure = |depth: &mut [f32]| {
            noise.apply(&camera, depth, &mut noise_stream(*seed, step, camera_idx))
        };
        self.renderer.capture(&camera, items, channels, measure)
    }
}

/// What is drawn of the scene's bodies, then of the robot's frames.
fn meshes(world: &World, renderer: &mut Renderer) -> Result<Vec<Vec<DrawnPart>>> {
    let scene = world.scene_items().map(|(_, _, parts)| parts.to_vec());
    let robot = world.robot_items().into_iter().map(|(_, parts)| parts);
    let mut drawn = |Part { shape, pose, rgb }: &Part| {
        Ok(DrawnPart { mesh: renderer.mesh(shape)?, body_from_part: *pose, rgb: *rgb })
    };
    scene.chain(robot).map(|parts| parts.iter().map(&mut drawn).collect()).collect()
}

/// The parts where they are now.
fn items(world: &World, bodies: &[Vec<DrawnPart>]) -> Vec<Item> {
    let poses = world.scene_items().map(|(_, pose, _)| pose).chain(world.robot_poses());
    let mut items = Vec::new();
    for (idx, (pose, parts)) in poses.zip(bodies).enumerate() {
        let id = NO_ITEM + 1 + idx as u16;
        items.extend(parts.iter().map(|DrawnPart { mesh, body_from_part, rgb }| {
            let world_from_mesh = pose * *body_from_part;
            Item { mesh: *mesh, world_from_mesh, rgb: *rgb, id }
        }));
    }
    items
}

#[cfg(test)]
mod tests;
