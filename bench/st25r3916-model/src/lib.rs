//! A behavioural model of the ST25R3916: SPI bytes, IRQ level, air, virtual time
