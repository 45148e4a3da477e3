//! Images of an episode's world, as its cameras measure them.

use super::SimEnvironment;
use crate::error::Result;
use crate::perception::{Camera, View};
use crate::sim::observing::render::{Capture, Channel, Item, Renderer};
use crate::sim::observing::{CameraRequest, Sensing, picture_items};
use crate::sim::world::World;
use glamx::Pose3;

impl SimEnvironment {
    /// Cameras measure with noise, and the scene looks otherwise, from now on: the same `seed`
    /// looks the same.
    ///
    /// [`crate::env::Environment::reset`] keeps the settings and takes the scene's seed.
    pub fn set_sensing(&mut self, settings: Sensing, seed: u64) {
        self.drawing.set_sensing(&self.world, settings, seed);
    }

    /// Cameras' errors and the scene's looks, if they were ever set.
    #[must_use]
    pub fn sensing(&self) -> Option<&Sensing> {
        self.drawing.sensing()
    }

    /// Images of built-in cameras now, each in its channels and size. The scene's own cameras are
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

    /// Image of a camera that stands anywhere, now.
    #[must_use]
    pub fn frame(&mut self, camera: Camera, channels: &[Channel]) -> Capture {
        self.drawing.capture(&self.world, camera, channels, self.step)
    }

    /// View of a built-in camera for an observation.
    pub(super) fn view(&mut self, name: &str) -> View {
        let camera = Camera::by_name(name, &self.robot, &self.world_from_flange())
            .expect("camera names were checked at construction");
        self.drawing.view(&self.world, camera, self.step)
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
        picture_items(world, renderer)
    }
}

#[cfg(test)]
mod tests;
