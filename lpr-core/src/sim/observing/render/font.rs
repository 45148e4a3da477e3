//! A font of 5 × 7 dots, drawn for this project.

/// Dots across a glyph.
pub(super) const GLYPH_WIDTH: usize = 5;
/// Dots down a glyph.
pub(super) const GLYPH_HEIGHT: usize = 7;

const FIRST: u8 = b' ';

/// Printable ASCII from the space on: seven rows of five bits, the top row in the highest bits, the
/// left dot first.
#[rustfmt::skip]
const GLYPHS: [u64; 95] = [
    0x0_0000_0000, 0x1_0842_1004, 0x2_94A0_0000, 0x2_95F5_7D4A, 0x1_1F47_17C4, 0x6_3222_2263, 0x3_2544_564D, 0x1_0840_0000,
    0x0_8884_2082, 0x2_0821_0888, 0x0_0957_5480, 0x0_084F_9080, 0x0_0000_3088, 0x0_000F_8000, 0x0_0000_018C, 0x0_4222_2210,
    0x3_A33A_E62E, 0x1_1842_108E, 0x3_A213_221F, 0x3_A213_062E, 0x0_8CA9_7C42, 0x7_E1E0_862E, 0x1_910F_462E, 0x7_C222_2108,
    0x3_A317_462E, 0x3_A317_844C, 0x0_18C0_3180, 0x0_18C0_3088, 0x0_8888_2082, 0x0_01F0_7C00, 0x2_0820_8888, 0x3_A211_1004,
    0x3_A37A_DE0E, 0x3_A31F_C631, 0x7_A31F_463E, 0x3_A308_422E, 0x7_A318_C63E, 0x7_E10F_421F, 0x7_E10F_4210, 0x3_A30B_C62F,
    0x4_631F_C631, 0x3_8842_108E, 0x1_C421_0A4C, 0x4_654C_5251, 0x4_2108_421F, 0x4_775A_C631, 0x4_739A_CE71, 0x3_A318_C62E,
    0x7_A31F_4210, 0x3_A318_D64D, 0x7_A31F_5251, 0x3_E107_043E, 0x7_C842_1084, 0x4_6318_C62E, 0x4_6318_C544, 0x4_631A_D771,
    0x4_62A2_2A31, 0x4_62A2_1084, 0x7_C222_221F, 0x3_9084_210E, 0x4_2082_0821, 0x3_8421_084E, 0x1_1510_0000, 0x0_0000_001F,
    0x2_0820_0000, 0x0_00E0_BE2F, 0x4_21E8_C63E, 0x0_00F8_420F, 0x0_42F8_C62F, 0x0_00E8_FE0E, 0x1_928E_2108, 0x0_00F8_BC2E,
    0x4_21E8_C631, 0x1_00C2_108E, 0x0_8061_0A4C, 0x4_212A_6292, 0x3_0842_108E, 0x0_01AA_D6B5, 0x0_01E8_C631, 0x0_00E8_C62E,
    0x0_01E8_FA10, 0x0_00F8_BC21, 0x0_016C_C210, 0x0_00F8_383E, 0x2_11C4_2126, 0x0_0118_C62F, 0x0_0118_C544, 0x0_0118_D6AA,
    0x0_0115_1151, 0x0_0118_BC2E, 0x0_01F1_111F, 0x0_8844_1082, 0x1_0842_1084, 0x2_0841_1088, 0x0_008A_8800,
];

/// Rows of a character from the top, the leftmost dot in bit 4; '?' for what is not printable
/// ASCII.
pub(super) fn glyph(character: char) -> [u8; GLYPH_HEIGHT] {
    let known =
        if character.is_ascii_graphic() || character == ' ' { character as u8 } else { b'?' };
    let bits = GLYPHS[usize::from(known - FIRST)];
    core::array::from_fn(|row| (bits >> (GLYPH_WIDTH * (GLYPH_HEIGHT - 1 - row))) as u8 & 0b1_1111)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn glyphs_read_as_drawn() {
        let picture =
            glyph('R').map(|row| format!("{row:05b}").replace('0', ".").replace('1', "#"));
        assert_eq!(picture, ["####.", "#...#", "#...#", "####.", "#.#..", "#..#.", "#...#"]);
        assert_eq!(glyph('\u{e9}'), glyph('?'));
        assert_eq!(glyph(' '), [0; GLYPH_HEIGHT]);
    }

    #[test]
    fn no_two_characters_look_the_same() {
        for first in 0..GLYPHS.len() {
            assert!(
                !GLYPHS[first + 1..].contains(&GLYPHS[first]),
                "{}",
                char::from(FIRST + first as u8)
            );
        }
    }
}
