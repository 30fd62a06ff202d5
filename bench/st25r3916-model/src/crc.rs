//! The two CRC-16 of the air: NFC-F (ISO 18092, FeliCa) and NFC-A (ISO 14443-3 annex B).

/// Returns the CRC-16 of NFC-F (polynomial 0x1021, initial value 0), most significant bit and byte first.
#[must_use]
pub fn nfc_f(bytes: &[u8]) -> [u8; 2] {
    let mut crc = 0u16;
    for &b in bytes {
        crc ^= u16::from(b) << 8;
        for _ in 0..8 {
            crc = if crc & 0x8000 != 0 { (crc << 1) ^ 0x1021 } else { crc << 1 };
        }
    }
    crc.to_be_bytes()
}

/// Returns the CRC-16 of NFC-A (polynomial 0x8408 reflected, initial value 0x6363), least significant byte first.
pub(crate) fn nfc_a(bytes: &[u8]) -> [u8; 2] {
    let mut crc = 0x6363u16;
    for &b in bytes {
        crc ^= u16::from(b);
        for _ in 0..8 {
            crc = if crc & 1 != 0 { (crc >> 1) ^ 0x8408 } else { crc >> 1 };
        }
    }
    crc.to_le_bytes()
}

#[cfg(test)]
mod tests {
    #[test]
    fn check_values_of_the_catalogue() {
        // The expected values are the check values of CRC-16/XMODEM and CRC-16/ISO-IEC-14443-3-A for "123456789".
        assert_eq!(super::nfc_f(b"123456789"), 0x31C3u16.to_be_bytes());
        assert_eq!(super::nfc_a(b"123456789"), 0xBF05u16.to_le_bytes());
    }
}
