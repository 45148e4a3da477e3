//! What the agent sees: cameras, observations, voxel grids.
