//! The vendor's two-finger gripper behind the tool's bus: its registers. Where its fingers are is
//! for the world to say.

use super::world::{Fingers, OPEN};
use crate::wire::{Rtu, RtuBody, gripper_register};

/// Device number of the gripper at the bus.
const SLAVE: u8 = 8;
/// Positions of the closed and the open gripper, pulses.
const RANGE: (f64, f64) = (-10.0, OPEN);
/// Pulses a second at one revolution a minute: our choice, a full stroke in 0.6 s at the vendor's
/// default of 1,500.
const PULSES_PER_SPEED: f64 = 1.0;
/// Slowest and fastest speed, revolutions a minute.
const SPEEDS: (u16, u16) = (1, 5000);
/// Version 3.4.3, which reports its status.
const VERSION: [u16; 3] = [3, 4, 3];
const MOVING: u16 = 1;

/// State of the gripper.
#[derive(Debug, Clone)]
pub(super) struct Gripper {
    enabled: u16,
    mode: u16,
    speed: u16,
    /// Pulses.
    target: i32,
}

impl Gripper {
    /// Open and off.
    pub(super) const fn new() -> Self {
        Self { enabled: 0, mode: 0, speed: 1500, target: RANGE.1 as i32 }
    }

    /// The command to the fingers.
    pub(super) fn fingers(&self) -> Fingers {
        let speed = f64::from(self.speed) * PULSES_PER_SPEED;
        Fingers { target: f64::from(self.target), speed }
    }

    /// The answer of the device, with its fingers at `position` (pulses), to a frame on its bus;
    /// none when the frame is not for it or makes no sense to it.
    pub(super) fn answer(&mut self, rtu: &Rtu, position: f64) -> Option<Vec<u8>> {
        if rtu.slave != SLAVE {
            return None;
        }
        match &rtu.body {
            RtuBody::Read { address, count } => {
                let values: Option<Vec<_>> =
                    (0..*count).map(|idx| self.read(address.checked_add(idx)?, position)).collect();
                Some(rtu.read_answer(&values?))
            }
            RtuBody::Write { address, values } => {
                self.write(*address, values);
                Some(rtu.write_answer(*address, values.len() as u16))
            }
            RtuBody::Other(_) => None,
        }
    }

    fn read(&self, address: u16, position: f64) -> Option<u16> {
        /// The second halves of numbers of 32 bits.
        const TARGET_LOW: u16 = gripper_register::TARGET + 1;
        const POSITION_LOW: u16 = gripper_register::POSITION + 1;
        let pulses = position.round() as i32;
        Some(match address {
            gripper_register::STATUS => self.status(position),
            gripper_register::ERROR => 0,
            gripper_register::ENABLE => self.enabled,
            gripper_register::MODE => self.mode,
            gripper_register::SPEED => self.speed,
            gripper_register::TARGET => (self.target >> 16) as u16,
            TARGET_LOW => self.target as u16,
            gripper_register::POSITION => (pulses >> 16) as u16,
            POSITION_LOW => pulses as u16,
            gripper_register::VERSION..=0x0803 => {
                VERSION[usize::from(address - gripper_register::VERSION)]
            }
            _ => return None,
        })
    }

    fn status(&self, position: f64) -> u16 {
        if (f64::from(self.target) - position).abs() > 0.5 { MOVING } else { 0 }
    }

    fn write(&mut self, address: u16, values: &[u16]) {
        match (address, values) {
            (gripper_register::ENABLE, [value]) => self.enabled = *value,
            (gripper_register::MODE, [value]) => self.mode = *value,
            (gripper_register::SPEED, [value]) => self.speed = (*value).clamp(SPEEDS.0, SPEEDS.1),
            (gripper_register::TARGET, [high, low]) => {
                let target = f64::from(i32::from(*high as i16) << 16 | i32::from(*low));
                self.target = target.clamp(RANGE.0, RANGE.1) as i32;
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::world::{KinematicWorld, Setpoint, World as _};
    use lpr_core::robot::XARM7;

    fn rtu(body: RtuBody) -> Rtu {
        Rtu { host: 9, slave: SLAVE, body }
    }

    /// A gripper with nothing between its fingers.
    struct Hand {
        gripper: Gripper,
        world: KinematicWorld,
    }

    impl Hand {
        fn new() -> Self {
            Self { gripper: Gripper::new(), world: KinematicWorld::at(XARM7.start) }
        }

        fn ask(&mut self, rtu: &Rtu) -> Option<Vec<u8>> {
            self.gripper.answer(rtu, self.world.fingers())
        }

        fn write(&mut self, address: u16, values: Vec<u16>) {
            self.ask(&rtu(RtuBody::Write { address, values })).unwrap();
        }

        fn read<const N: usize>(&mut self, address: u16) -> [u8; N] {
            let answer = self.ask(&rtu(RtuBody::Read { address, count: N as u16 / 2 })).unwrap();
            assert_eq!(answer[..4], [9, SLAVE, 3, N as u8]);
            answer[4..].try_into().unwrap()
        }

        fn position(&mut self) -> i32 {
            i32::from_be_bytes(self.read(gripper_register::POSITION))
        }

        fn status(&mut self) -> u16 {
            u16::from_be_bytes(self.read(gripper_register::STATUS))
        }

        fn advance(&mut self, dt_secs: f64) {
            let setpoint = Setpoint { joints: XARM7.start, fingers: self.gripper.fingers() };
            self.world.advance(dt_secs, &setpoint);
        }
    }

    #[test]
    fn it_goes_where_it_is_told_at_its_speed() {
        let mut hand = Hand::new();
        hand.write(gripper_register::SPEED, vec![100]);
        hand.write(gripper_register::TARGET, vec![0, 600]);
        hand.advance(1.0);
        assert_eq!((hand.position(), hand.status()), (750, MOVING));
        hand.advance(10.0);
        assert_eq!((hand.position(), hand.status()), (600, 0));
    }

    #[test]
    fn it_stays_within_its_range_and_does_not_answer_for_others() {
        let mut hand = Hand::new();
        // -1000 pulses.
        hand.write(gripper_register::TARGET, vec![0xffff, 0xfc18]);
        hand.advance(10.0);
        assert_eq!(hand.position(), -10);
        let other = Rtu { host: 9, slave: 1, body: RtuBody::Read { address: 0, count: 1 } };
        assert_eq!(hand.ask(&other), None);
        assert_eq!(hand.ask(&rtu(RtuBody::Read { address: 0x0f00, count: 1 })), None);
    }
}
