//! Bodies that fall off the table: they come to rest below it instead of falling, and costing time,
//! for ever.

use super::World;
use rapier3d::prelude::RigidBodyHandle;

/// Below this a body rests where it is and touches nothing any more, world z in metres: deeper than
/// any task looks.
const REST_Z: f32 = -1.0;

impl World {
    /// Takes bodies that have fallen out of the simulation; they keep their last poses.
    pub(super) fn rest_fallen(&mut self) {
        for idx in 0..self.bodies.len() {
            let handle = self.bodies[idx];
            if self.has_fallen(handle) {
                self.physics.bodies[handle].set_enabled(false);
            }
        }
    }

    fn has_fallen(&self, handle: RigidBodyHandle) -> bool {
        let body = &self.physics.bodies[handle];
        body.translation().z < REST_Z && body.is_dynamic() && body.is_enabled()
    }

    /// Gives a body this velocity, m/s.
    #[cfg(test)]
    pub(in crate::sim) fn throw(&mut self, body: usize, velocity: glamx::Vec3) {
        self.physics.bodies[self.bodies[body]].set_linvel(velocity, true);
    }
}
