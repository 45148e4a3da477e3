//! The z-buffer: which triangle each pixel sees, and at what depth.
//!
//! Edge functions are evaluated from exactly negated coefficients on both sides of a shared edge,
//! so adjacent triangles leave no gap. The inverse depth of a face comes from its plane, not from
//! its corners, so clipping does not change it.

use super::mesh::Mesh;
use crate::perception::Camera;
use glamx::{Mat3, Pose3, Vec2, Vec3};

/// Pixels tested at once: the width that 128-bit vector units and wasm share.
const LANES: usize = 4;
/// Column of each lane's pixel centre, pixels.
const LANE_CENTERS: [f32; LANES] = [0.5, 1.5, 2.5, 3.5];
/// Triangles wider than this have their span solved row by row; for narrower ones testing all
/// pixels costs less.
const WIDE: usize = 3 * LANES;
/// Entry of [`Raster::faces`] for pixels that see nothing.
pub(super) const NO_FACE: u32 = 0;

/// A triangle that pixels may see.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    pub(super) item_idx: u32,
    pub(super) triangle_idx: u32,
}

#[derive(Debug, Clone, Copy)]
struct Vertex {
    /// In the frame of the camera, metres.
    local: Vec3,
    image: Vec2,
}

/// `value = x * dx + (y * dy + origin)` over image coordinates.
#[derive(Debug, Clone, Copy)]
struct Linear {
    dx: f32,
    dy: f32,
    origin: f32,
}

impl Linear {
    /// Positive on the inner side of the edge from `a` to `b` of a triangle that faces the camera.
    fn edge(a: Vec2, b: Vec2) -> Self {
        Self { dx: b.y - a.y, dy: a.x - b.x, origin: b.x * a.y - a.x * b.y }
    }

    fn at_row(self, y: f32) -> f32 {
        y * self.dy + self.origin
    }
}

/// Inverse depth of a plane over the image, with the range that its visible part has.
#[derive(Debug, Clone, Copy)]
struct InverseDepth {
    plane: Linear,
    /// The range matters for planes seen edge-on, where the plane alone is ill-conditioned.
    min: f32,
    max: f32,
}

/// Columns and rows, end exclusive.
#[derive(Debug, Clone, Copy)]
struct PixelBox {
    columns: [usize; 2],
    rows: [usize; 2],
}

/// Pose of a mesh relative to the camera.
struct Placement {
    rotation: Mat3,
    translation: Vec3,
    crosses_near: bool,
}

/// Depth and face buffers of one image; reused from image to image.
#[derive(Debug, Clone, Default)]
pub(super) struct Raster {
    width: usize,
    height: usize,
    /// Groups of [`LANES`] pixels in a row of the buffers.
    stride: usize,
    /// Reciprocal of the depth along the optical axis, 1/m; larger is nearer.
    inverse_depth: Vec<[f32; LANES]>,
    face_idx: Vec<[u32; LANES]>,
    faces: Vec<Face>,
    vertices: Vec<Vertex>,
}

impl Raster {
    /// Forgets everything and takes the size of `camera`'s image.
    pub(super) fn clear(&mut self, camera: &Camera) {
        self.width = camera.width;
        self.height = camera.height;
        self.stride = camera.width.div_ceil(LANES);
        let groups = self.stride * self.height;
        self.inverse_depth.clear();
        self.inverse_depth.resize(groups, [1.0 / camera.far; LANES]);
        self.face_idx.clear();
        self.face_idx.resize(groups, [NO_FACE; LANES]);
        self.faces.clear();
        self.faces.push(Face { item_idx: u32::MAX, triangle_idx: u32::MAX });
    }

    /// The faces that [`Self::row`] refers to; the first stands for nothing.
    pub(super) fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// Inverse depth (1/m) and index into [`Self::faces`] of the pixels of row `y`.
    pub(super) fn row(&self, y: usize) -> (&[f32], &[u32]) {
        let groups = y * self.stride..(y + 1) * self.stride;
        let depth = self.inverse_depth[groups.clone()].as_flattened();
        (&depth[..self.width], &self.face_idx[groups].as_flattened()[..self.width])
    }

    /// Draws the mesh of item `item_idx`.
    pub(super) fn draw(
        &mut self,
        camera: &Camera,
        item_idx: usize,
        mesh: &Mesh,
        world_from_mesh: &Pose3,
    ) {
        let Some(placement) = place(camera, mesh, world_from_mesh) else { return };
        let Placement { rotation, translation, crosses_near } = placement;
        self.vertices.clear();
        self.vertices.extend(mesh.vertices.iter().map(|&vertex| {
            let local = rotation * vertex + translation;
            Vertex { local, image: image_point(camera, local) }
        }));
        let eye = -(rotation.transpose() * translation);
        for (triangle_idx, (normal, offset)) in mesh.normals.iter().zip(&mesh.offsets).enumerate() {
            let distance = normal.dot(eye) - offset;
            if distance <= 0.0 {
                continue;
            }
            let corners = mesh.triangles[triangle_idx].map(|idx| self.vertices[idx as usize]);
            let face = Face { item_idx: item_idx as u32, triangle_idx: triangle_idx as u32 };
            let plane = || inverse_depth_plane(camera, rotation * *normal, distance);
            if crosses_near && corners.iter().any(|corner| corner.local.z < camera.near) {
                let (polygon, n_corners) = clipped(camera, corners);
                for idx in 2..n_corners {
                    self.fill(face, [polygon[0], polygon[idx - 1], polygon[idx]], plane);
                }
            } else {
                self.fill(face, corners, plane);
            }
        }
    }

    /// Draws a triangle in front of the near plane; `plane` is asked for only when the triangle
    /// covers pixels.
    fn fill(&mut self, face: Face, corners: [Vertex; 3], plane: impl Fn() -> Linear) {
        let [a, b, c] = corners.map(|corner| corner.image);
        let Some(pixels) = self.pixel_box(a, b, c) else { return };
        let depths = corners.map(|corner| corner.local.z);
        let inverse_depth = InverseDepth {
            plane: plane(),
            min: 1.0 / depths[0].max(depths[1]).max(depths[2]),
            max: 1.0 / depths[0].min(depths[1]).min(depths[2]),
        };
        let face_idx = self.faces.len() as u32;
        self.faces.push(face);
        self.scan(
            pixels,
            [Linear::edge(a, b), Linear::edge(b, c), Linear::edge(c, a)],
            inverse_depth,
            face_idx,
        );
    }

    /// The pixels whose centres may lie within the triangle.
    fn pixel_box(&self, a: Vec2, b: Vec2, c: Vec2) -> Option<PixelBox> {
        let low = a.min(b).min(c) + Vec2::splat(0.5);
        let high = a.max(b).max(c) + Vec2::splat(0.5);
        // Truncation of a value that is not negative is its floor; casts saturate.
        let first = |value: f32| {
            let floor = value as usize;
            floor.saturating_sub(usize::from(floor as f32 == value))
        };
        let columns = [first(low.x), (high.x as usize).min(self.width)];
        let rows = [first(low.y), (high.y as usize).min(self.height)];
        (columns[0] < columns[1] && rows[0] < rows[1]).then_some(PixelBox { columns, rows })
    }

    fn scan(&mut self, pixels: PixelBox, edges: [Linear; 3], depth: InverseDepth, face_idx: u32) {
        let columns = pixels.columns;
        let crossing_per_value = edges.map(|edge| -1.0 / edge.dx);
        for y in pixels.rows[0]..pixels.rows[1] {
            let center = y as f32 + 0.5;
            let edge_rows = edges.map(|edge| Row { dx: edge.dx, left: edge.at_row(center) });
            let depth_row = Row { dx: depth.plane.dx, left: depth.plane.at_row(center) };
            let [start, end] = if columns[1] - columns[0] > WIDE {
                span(columns, edge_rows, crossing_per_value)
            } else {
                columns
            };
            let [first, last] = [start / LANES, end.div_ceil(LANES)];
            if first >= last {
                continue;
            }
            let groups = y * self.stride + first..y * self.stride + last;
            let buffers =
                self.inverse_depth[groups.clone()].iter_mut().zip(&mut self.face_idx[groups]);
            let mut x = LANE_CENTERS.map(|lane_center| (first * LANES) as f32 + lane_center);
            for (nearest, faces) in buffers {
                let [ab, bc, ca] = edge_rows.map(|row| row.at(x));
                let value = clamped(depth_row.at(x), depth.min, depth.max);
                let visible = visible_lanes(least(least(ab, bc), ca), value, *nearest);
                *nearest = chosen(visible, value.map(f32::to_bits), nearest.map(f32::to_bits))
                    .map(f32::from_bits);
                *faces = chosen(visible, [face_idx; LANES], *faces);
                x = x.map(|x| x + LANES as f32);
            }
        }
    }
}

/// A [`Linear`] function along one row.
#[derive(Debug, Clone, Copy)]
struct Row {
    dx: f32,
    left: f32,
}

type Lanes = [f32; LANES];

/// The part of `columns` that holds all pixels of a row within the edges, with a pixel to spare on
/// either side for rounding.
fn span(columns: [usize; 2], edge_rows: [Row; 3], crossing_per_value: [f32; 3]) -> [usize; 2] {
    let (mut start, mut end) = (columns[0] as f32, columns[1] as f32);
    for (edge, per_value) in edge_rows.iter().zip(crossing_per_value) {
        let crossing = edge.left * per_value;
        if edge.dx > 0.0 {
            start = start.max(crossing - 1.0);
        } else if edge.dx < 0.0 {
            end = end.min(crossing + 1.0);
        }
    }
    [start as usize, (end as usize).min(columns[1])]
}

impl Row {
    #[inline(always)]
    fn at(self, x: Lanes) -> Lanes {
        x.map(|x| x * self.dx + self.left)
    }
}

// These are written without branches over whole groups, so that the compiler uses vector
// instructions.

#[inline(always)]
fn least(a: Lanes, b: Lanes) -> Lanes {
    core::array::from_fn(|lane| if a[lane] < b[lane] { a[lane] } else { b[lane] })
}

#[inline(always)]
fn clamped(values: Lanes, min: f32, max: f32) -> Lanes {
    values.map(|value| {
        let value = if value < max { value } else { max };
        if value > min { value } else { min }
    })
}

/// All bits set where the pixel is inside the triangle and nearer than what it saw.
#[inline(always)]
fn visible_lanes(inside: Lanes, value: Lanes, nearest: Lanes) -> [u32; LANES] {
    core::array::from_fn(|lane| {
        u32::from((inside[lane] >= 0.0) & (value[lane] > nearest[lane])).wrapping_neg()
    })
}

#[inline(always)]
fn chosen(mask: [u32; LANES], yes: [u32; LANES], no: [u32; LANES]) -> [u32; LANES] {
    core::array::from_fn(|lane| (yes[lane] & mask[lane]) | (no[lane] & !mask[lane]))
}

/// The placement of the mesh, or `None` when its bounding ball is outside the camera's view.
fn place(camera: &Camera, mesh: &Mesh, world_from_mesh: &Pose3) -> Option<Placement> {
    let camera_from_mesh = camera.world_from_camera.inv_mul(world_from_mesh);
    let center = camera_from_mesh.translation;
    let radius = mesh.radius;
    let beyond_side = |across: f32, focal: f32, side: f32| {
        across * focal - center.z * side > radius * libm::sqrtf(focal * focal + side * side)
    };
    let outside = center.z + radius < camera.near
        || center.z - radius > camera.far
        || beyond_side(-center.x, camera.fx, camera.cx)
        || beyond_side(center.x, camera.fx, camera.width as f32 - camera.cx)
        || beyond_side(-center.y, camera.fy, camera.cy)
        || beyond_side(center.y, camera.fy, camera.height as f32 - camera.cy);
    (!outside).then(|| Placement {
        rotation: Mat3::from_quat(camera_from_mesh.rotation),
        translation: center,
        crosses_near: center.z - radius < camera.near,
    })
}

fn image_point(camera: &Camera, local: Vec3) -> Vec2 {
    let inverse = 1.0 / local.z;
    Vec2::new(camera.cx + camera.fx * local.x * inverse, camera.cy + camera.fy * local.y * inverse)
}

/// Inverse depth over the image of the plane with `normal` (in the camera's frame) at `distance` in
/// front of the eye.
fn inverse_depth_plane(camera: &Camera, normal: Vec3, distance: f32) -> Linear {
    // normal · (ray z) = -distance for the ray ((x - cx) / fx, (y - cy) / fy, 1).
    let scaled = normal * (-1.0 / distance);
    let (dx, dy) = (scaled.x / camera.fx, scaled.y / camera.fy);
    Linear { dx, dy, origin: scaled.z - dx * camera.cx - dy * camera.cy }
}

/// The part of a triangle in front of the near plane: up to four corners and their number
/// (Sutherland and Hodgman).
fn clipped(camera: &Camera, corners: [Vertex; 3]) -> ([Vertex; 4], usize) {
    let mut polygon = [corners[0]; 4];
    let mut n_corners = 0;
    let mut push = |corner| {
        polygon[n_corners] = corner;
        n_corners += 1;
    };
    for (idx, &from) in corners.iter().enumerate() {
        let to = corners[(idx + 1) % 3];
        if from.local.z >= camera.near {
            push(from);
        }
        if (from.local.z >= camera.near) != (to.local.z >= camera.near) {
            // From the nearer end whichever way the edge runs, so that adjacent triangles share the
            // new corner exactly.
            let (near, far) = if from.local.z < to.local.z {
                (from.local, to.local)
            } else {
                (to.local, from.local)
            };
            let mut local = near + (far - near) * ((camera.near - near.z) / (far.z - near.z));
            local.z = camera.near;
            push(Vertex { local, image: image_point(camera, local) });
        }
    }
    (polygon, n_corners)
}
