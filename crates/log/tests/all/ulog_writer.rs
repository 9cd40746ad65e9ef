//! A writer of ULog files, for tests.

#![allow(dead_code, reason = "each test binary includes this file and uses what it needs")]

/// A file in the making.
pub(crate) struct Ulog {
    pub(crate) bytes: Vec<u8>,
}

impl Ulog {
    /// A file that begins at a time, microseconds.
    pub(crate) fn new(start: u64) -> Self {
        let mut bytes = b"ULog\x01\x12\x35\x01".to_vec();
        bytes.extend(start.to_le_bytes());
        Self { bytes }
    }

    /// Appends a message.
    pub(crate) fn message(&mut self, kind: u8, parts: &[&[u8]]) -> &mut Self {
        let payload = parts.concat();
        self.bytes.extend(u16::try_from(payload.len()).unwrap().to_le_bytes());
        self.bytes.push(kind);
        self.bytes.extend(payload);
        self
    }

    /// Flags: the first bytes of the compatible and of the incompatible ones, and where data were appended.
    pub(crate) fn flags(&mut self, compatible: u8, incompatible: [u8; 8], appended: [u64; 3]) -> &mut Self {
        let offsets: Vec<u8> = appended.iter().flat_map(|offset| offset.to_le_bytes()).collect();
        self.message(b'B', &[&[compatible, 0, 0, 0, 0, 0, 0, 0], &incompatible, &offsets])
    }

    /// `name:type field;...`
    pub(crate) fn format(&mut self, text: &str) -> &mut Self {
        self.message(b'F', &[text.as_bytes()])
    }

    /// A value under a key, e.g. `int32_t SYS_ID`, as information (`I`) or parameter (`P`).
    pub(crate) fn entry(&mut self, kind: u8, key: &str, value: &[u8]) -> &mut Self {
        self.message(kind, &[&[key.len() as u8], key.as_bytes(), value])
    }

    /// A value behind a byte of flags: a part of information (`M`), a default (`Q`).
    pub(crate) fn flagged(&mut self, kind: u8, flags: u8, key: &str, value: &[u8]) -> &mut Self {
        self.message(kind, &[&[flags, key.len() as u8], key.as_bytes(), value])
    }

    /// Data of a format come under a number from now on.
    pub(crate) fn subscribe(&mut self, instance: u8, id: u16, format: &str) -> &mut Self {
        self.message(b'A', &[&[instance], &id.to_le_bytes(), format.as_bytes()])
    }

    pub(crate) fn data(&mut self, id: u16, parts: &[&[u8]]) -> &mut Self {
        let parts = parts.concat();
        self.message(b'D', &[&id.to_le_bytes(), &parts])
    }

    /// A text with a level and a time, microseconds.
    pub(crate) fn logged(&mut self, level: u8, time: u64, text: &str) -> &mut Self {
        self.message(b'L', &[&[level], &time.to_le_bytes(), text.as_bytes()])
    }

    pub(crate) fn tagged(&mut self, level: u8, tag: u16, time: u64, text: &str) -> &mut Self {
        self.message(b'C', &[&[level], &tag.to_le_bytes(), &time.to_le_bytes(), text.as_bytes()])
    }

    pub(crate) fn sync(&mut self) -> &mut Self {
        self.message(b'S', &[&[0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12]])
    }

    /// Milliseconds of which nothing was written.
    pub(crate) fn dropout(&mut self, duration: u16) -> &mut Self {
        self.message(b'O', &[&duration.to_le_bytes()])
    }
}

/// Every type, nested and padded: two gyroscopes, an engine with two controllers, a mode with a text; logged texts, parameters, a dropout.
///
/// The gyroscopes come each 4 ms from 1 s on, `rounds` times; the engine each fifth time, the mode each tenth.
pub(crate) fn flight(rounds: u64) -> Ulog {
    let mut log = Ulog::new(900_000);
    log.flags(1, [0; 8], [0; 3])
        .format("gyro:uint64_t timestamp;uint64_t timestamp_sample;float[3] rate;double bias;int8_t a;uint8_t[3] _padding0;")
        .format("engine:uint64_t timestamp;bool armed;uint8_t[7] _padding0;controller[2] esc;uint16_t[1] one;")
        .format("controller:int32_t rpm;uint16_t volts;int16_t amps;uint8_t[2] _padding0;int64_t big;")
        .format("mode:uint32_t count;uint64_t timestamp;char[8] name;uint64_t flags;uint8_t[5] _padding0;uint8_t[2] _padding1;")
        .entry(b'I', "char[3] sys_name", b"PX4")
        .entry(b'I', "uint32_t ver_sw_release", &0x0101_0dff_u32.to_le_bytes())
        .flagged(b'M', 0, "char[5] boot", b"first")
        .flagged(b'M', 1, "char[4] boot", b", on")
        .flagged(b'M', 0, "char[6] boot", b"second")
        .entry(b'P', "float RATE_P", &0.15_f32.to_le_bytes())
        .entry(b'P', "int32_t SYS_ID", &(-3_i32).to_le_bytes())
        .flagged(b'Q', 3, "float RATE_P", &0.1_f32.to_le_bytes())
        .flagged(b'Q', 2, "int32_t SYS_ID", &7_i32.to_le_bytes())
        .subscribe(0, 0, "gyro")
        .subscribe(1, 7, "gyro")
        .subscribe(0, 3, "engine")
        .subscribe(0, 4, "mode")
        .subscribe(2, 9, "gyro")
        .logged(b'6', 950_000, "ready");
    for k in 0..rounds {
        let time = 1_000_000 + 4_000 * k;
        for (id, sign) in [(0, 1.0_f32), (7, -1.0)] {
            let rate: Vec<u8> =
                (0..3).flat_map(|axis| (sign * (k as f32).mul_add(0.1, axis as f32)).to_le_bytes()).collect();
            let (sample, bias) = ((time - 300).to_le_bytes(), (k as f64 / 3.0).to_le_bytes());
            log.data(id, &[&time.to_le_bytes(), &sample, &rate, &bias, &[k as u8]]);
        }
        if k % 5 == 0 {
            let esc = |rpm: i32| {
                let mut bytes = (rpm + k as i32).to_le_bytes().to_vec();
                bytes.extend(65_000_u16.to_le_bytes());
                bytes.extend((-7_i16).to_le_bytes());
                bytes.extend([9, 9]);
                bytes.extend((i64::MIN + k as i64).to_le_bytes());
                bytes
            };
            let (first, second) = (esc(-1000), esc(2000));
            log.data(
                3,
                &[&time.to_le_bytes(), &[u8::from(k % 2 == 0)], &[5; 7], &first, &second, &515_u16.to_le_bytes()],
            );
        }
        if k % 10 == 0 {
            let name: &[u8; 8] = if k % 20 == 0 { b"manual\0x" } else { b"position" };
            log.data(4, &[&(k as u32).to_le_bytes(), &time.to_le_bytes(), name, &u64::MAX.to_le_bytes()]);
        }
        match k % 25 {
            7 => {
                log.sync();
            }
            11 => {
                log.tagged(b'4', 513, time, "low voltage");
            }
            13 => {
                log.entry(b'P', "float RATE_P", &(0.2_f32 + k as f32).to_le_bytes());
            }
            17 => {
                log.entry(b'I', "char[2] time_ref", b"ok");
            }
            _ => {}
        }
    }
    log
}
