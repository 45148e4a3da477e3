//! Colours: the sRGB transfer curve and a perceptual scale for values.

/// Entries of the table that turns linear light into sRGB.
const ENCODE_STEPS: usize = 4096;

/// The sRGB transfer curve in both directions, as tables.
#[derive(Debug)]
pub(super) struct Transfer {
    linear: [f32; 256],
    encoded: Vec<u8>,
}

impl Transfer {
    pub(super) fn new() -> Self {
        let linear = core::array::from_fn(|byte| decode(byte as f32 / 255.0));
        let encoded = (0..=ENCODE_STEPS)
            .map(|step| (encode(step as f32 / ENCODE_STEPS as f32) * 255.0 + 0.5) as u8)
            .collect();
        Self { linear, encoded }
    }

    /// Linear light, 0 to 1.
    pub(super) fn decode(&self, rgb: [u8; 3]) -> [f32; 3] {
        rgb.map(|byte| self.linear[usize::from(byte)])
    }

    /// sRGB of linear light; brighter than 1 is white.
    pub(super) fn encode(&self, light: [f32; 3]) -> [u8; 3] {
        // Casts saturate at zero.
        light.map(|light| {
            self.encoded[((light * ENCODE_STEPS as f32 + 0.5) as usize).min(ENCODE_STEPS)]
        })
    }
}

/// IEC 61966-2-1.
fn decode(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { libm::powf((value + 0.055) / 1.055, 2.4) }
}

/// IEC 61966-2-1.
fn encode(light: f32) -> f32 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * libm::powf(light, 1.0 / 2.4) - 0.055 }
}

/// Colour of a value between 0 (dark violet) and 1 (bright yellow); values outside take the ends'
/// colours.
///
/// A line in Oklab's lightness and hue: equal steps of the value look equally far apart, also in
/// grey.
#[must_use]
pub fn value_color(value: f32) -> [u8; 3] {
    let value = if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
    let lightness = 0.34 + 0.57 * value;
    // Violet (300°) through blue, teal and green to yellow (105°); the chroma stays within sRGB,
    // which has little in the teals (0.104 at value 0.45).
    let hue = (300.0 - 195.0 * value).to_radians();
    let chroma = 0.145 + 0.03 * value - 0.235 * value * (1.0 - value);
    let (sin, cos) = libm::sincosf(hue);
    srgb_from_oklab(lightness, chroma * cos, chroma * sin)
}

/// Björn Ottosson's Oklab; colours outside sRGB are clipped.
fn srgb_from_oklab(lightness: f32, a: f32, b: f32) -> [u8; 3] {
    let cube = |value: f32| value * value * value;
    let l = cube(lightness + 0.396_337_78 * a + 0.215_803_76 * b);
    let m = cube(lightness - 0.105_561_346 * a - 0.063_854_17 * b);
    let s = cube(lightness - 0.089_484_18 * a - 1.291_485_5 * b);
    let linear = [
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_38 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    ];
    linear.map(|light| (encode(light.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transfer_curve_round_trips_every_byte() {
        let transfer = Transfer::new();
        for byte in 10..=255 {
            assert_eq!(transfer.encode(transfer.decode([byte; 3])), [byte; 3]);
        }
        assert_eq!(transfer.encode([2.0, -1.0, 0.0]), [255, 0, 0]);
    }

    #[test]
    fn oklab_of_greys_is_grey() {
        for lightness in [0.0, 0.3, 0.7, 1.0] {
            let [r, g, b] = srgb_from_oklab(lightness, 0.0, 0.0);
            assert!(r.abs_diff(g) <= 1 && g.abs_diff(b) <= 1, "{r} {g} {b}");
        }
        assert_eq!(srgb_from_oklab(1.0, 0.0, 0.0), [255; 3]);
    }

    #[test]
    fn larger_values_are_brighter() {
        let luminance = |value: f32| {
            let [r, g, b] = value_color(value).map(|byte| decode(f32::from(byte) / 255.0));
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for step in 0..50 {
            let (low, high) = (luminance(step as f32 / 50.0), luminance((step + 1) as f32 / 50.0));
            assert!(low < high, "{step}: {low} {high}");
        }
        assert_eq!(value_color(f32::NAN), value_color(0.0));
        assert_eq!(value_color(7.0), value_color(1.0));
    }
}
