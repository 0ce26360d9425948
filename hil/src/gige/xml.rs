//! The GenICam description of the registers (GenApi 1.1 schema, names of the SFNC 2.x).

use super::gvsp::{EXPOSURE_CHUNK, FRAME_ID_CHUNK, TIMESTAMP_CHUNK};
use super::map;
use super::settings::Settings;

/// Categories and their features, in the order in which programs show them.
const CATEGORIES: [(&str, &[&str]); 6] = [
    (
        "DeviceControl",
        &[
            "DeviceVendorName",
            "DeviceModelName",
            "DeviceVersion",
            "DeviceManufacturerInfo",
            "DeviceSerialNumber",
            "DeviceUserID",
        ],
    ),
    (
        "ImageFormatControl",
        &[
            "SensorWidth",
            "SensorHeight",
            "WidthMax",
            "HeightMax",
            "Width",
            "Height",
            "OffsetX",
            "OffsetY",
            "PixelFormat",
        ],
    ),
    (
        "AcquisitionControl",
        &[
            "AcquisitionMode",
            "AcquisitionStart",
            "AcquisitionStop",
            "AcquisitionFrameRateEnable",
            "AcquisitionFrameRate",
            "TriggerSelector",
            "TriggerMode",
            "TriggerSource",
            "TriggerActivation",
            "TriggerSoftware",
            "ExposureMode",
            "ExposureTime",
            "Gain",
            "BlackLevel",
        ],
    ),
    ("DigitalIOControl", &["LineSelector", "LineMode", "LineSource"]),
    (
        "ChunkDataControl",
        &[
            "ChunkModeActive",
            "ChunkSelector",
            "ChunkEnable",
            "ChunkFrameID",
            "ChunkTimestamp",
            "ChunkExposureTime",
        ],
    ),
    (
        "TransportLayerControl",
        &[
            "PayloadSize",
            "TLParamsLocked",
            "GevVersionMajor",
            "GevHeartbeatTimeout",
            "GevTimestampTickFrequency",
            "GevTimestampControlLatch",
            "GevTimestampControlReset",
            "GevTimestampValue",
            "GevSCPHostPort",
            "GevSCDA",
            "GevSCPD",
            "GevSCPSPacketSize",
            "GevSCPSDoNotFragment",
            "GevSCPSFireTestPacket",
        ],
    ),
];

/// A text that grows by nodes.
struct Nodes(String);

/// Where a register's bank comes from: a selector's register, and from one bank to the next.
type Bank = Option<(&'static str, u32)>;

impl Nodes {
    fn add(&mut self, node: &str) {
        self.0.push_str(node);
        self.0.push('\n');
    }

    /// `inside` of the node of a feature.
    fn feature(&mut self, kind: &str, name: &str, inside: &str) {
        self.add(&format!(
            "<{kind} Name=\"{name}\" NameSpace=\"Standard\">{inside}</{kind}>"
        ));
    }

    fn register(&mut self, kind: &str, name: &str, at: u32, (length, access): (usize, &str), bank: Bank) {
        let bank = bank.map_or(String::new(), |(selector, offset)| {
            format!("<pIndex Offset=\"{offset}\">{selector}Reg</pIndex>")
        });
        let ends = match kind {
            "IntReg" => "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess>",
            "FloatReg" => "<Endianess>BigEndian</Endianess>",
            _ => "",
        };
        self.add(&format!(
            "<{kind} Name=\"{name}\"><Address>0x{at:x}</Address>{bank}<Length>{length}</Length>\
             <AccessMode>{access}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>{ends}</{kind}>"
        ));
    }

    fn text(&mut self, name: &str, (at, length): (u32, usize), access: &str) {
        let lengths = format!(
            "<Address>0x{at:x}</Address><Length>{length}</Length><AccessMode>{access}</AccessMode>\
             <pPort>Device</pPort>"
        );
        self.feature("StringReg", name, &lengths);
    }

    fn integer(&mut self, name: &str, at: u32, access: &str, limits: &str) {
        let register = format!("{name}Reg");
        self.feature("Integer", name, &format!("<pValue>{register}</pValue>{limits}"));
        self.register("IntReg", &register, at, (4, access), None);
    }

    fn float(&mut self, name: &str, at: u32, (least, most): (f64, f64), unit: &str) {
        let register = format!("{name}Reg");
        let limits = format!("<Min>{least}</Min><Max>{most}</Max><Unit>{unit}</Unit>");
        self.feature("Float", name, &format!("<pValue>{register}</pValue>{limits}"));
        self.register("FloatReg", &register, at, (8, "RW"), None);
    }

    fn enumeration(
        &mut self,
        name: &str,
        at: u32,
        access: &str,
        bank: Bank,
        entries: &[(&str, u32)],
        extra: &str,
    ) {
        let entries = entries.iter().map(|(entry, value)| {
            format!("<EnumEntry Name=\"{entry}\" NameSpace=\"Standard\"><Value>{value}</Value></EnumEntry>")
        });
        let entries = entries.collect::<Vec<_>>().concat();
        let register = format!("{name}Reg");
        self.feature(
            "Enumeration",
            name,
            &format!("{extra}{entries}<pValue>{register}</pValue>"),
        );
        self.register("IntReg", &register, at, (4, access), bank);
    }

    fn boolean(&mut self, name: &str, at: u32, bank: Bank, extra: &str) {
        let register = format!("{name}Reg");
        let inside = format!("{extra}<pValue>{register}</pValue><OnValue>1</OnValue><OffValue>0</OffValue>");
        self.feature("Boolean", name, &inside);
        self.register("IntReg", &register, at, (4, "RW"), bank);
    }

    /// A command whose register `register` is there already, or is made at `at`.
    fn command(&mut self, name: &str, value: u32, register: &str, at: Option<u32>, bank: Bank) {
        let inside = format!("<pValue>{register}</pValue><CommandValue>{value}</CommandValue>");
        self.feature("Command", name, &inside);
        if let Some(at) = at {
            self.register("IntReg", register, at, (4, "WO"), bank);
        }
    }

    /// Bits of the stream packet size.
    fn packet_size_bits(&mut self, register: &str, bits: &str) {
        self.add(&format!(
            "<MaskedIntReg Name=\"{register}\"><Address>0x{:x}</Address><Length>4</Length>\
             <AccessMode>RW</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>{bits}\
             <Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>",
            map::PACKET_SIZE
        ));
    }

    fn chunk(&mut self, kind: &str, name: &str, id: u32) {
        let (feature, sign) = match kind {
            "IntReg" => ("Integer", "<Sign>Unsigned</Sign>"),
            _ => ("Float", ""),
        };
        self.feature(feature, name, &format!("<pValue>{name}Reg</pValue>"));
        self.add(&format!(
            "<{kind} Name=\"{name}Reg\"><Address>0</Address><Length>8</Length><AccessMode>RO</AccessMode>\
             <pPort>{name}Port</pPort>{sign}<Endianess>BigEndian</Endianess></{kind}>\
             <Port Name=\"{name}Port\"><ChunkID>{id:x}</ChunkID></Port>"
        ));
    }
}

/// The XML of a camera.
pub(super) fn describe(settings: &Settings) -> String {
    let mut nodes = Nodes(String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<RegisterDescription ModelName=\"TestCamera\" \
         VendorName=\"RCG\" StandardNameSpace=\"GEV\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" \
         SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" \
         ToolTip=\"Camera of the tests\" ProductGuid=\"8b6f0f0e-6c1f-4f2c-9b0f-2f1f6f5c7a01\" \
         VersionGuid=\"8b6f0f0e-6c1f-4f2c-9b0f-2f1f6f5c7a02\" \
         xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">\n",
    ));
    let without_chunks = |name: &&str| settings.chunks || !name.contains("Chunk");
    let shown: Vec<_> = CATEGORIES
        .iter()
        .filter(|(name, _)| without_chunks(name))
        .collect();
    let names = |names: &mut dyn Iterator<Item = &str>| {
        let features = names.map(|name| format!("<pFeature>{name}</pFeature>"));
        features.collect::<Vec<_>>().concat()
    };
    nodes.feature(
        "Category",
        "Root",
        &names(&mut shown.iter().map(|(name, _)| *name)),
    );
    for (name, features) in shown {
        nodes.feature("Category", name, &names(&mut features.iter().copied()));
    }
    device(&mut nodes);
    image_format(&mut nodes, settings);
    acquisition(&mut nodes);
    lines(&mut nodes);
    if settings.chunks {
        chunks(&mut nodes);
    }
    transport(&mut nodes);
    nodes.add("<Port Name=\"Device\" NameSpace=\"Standard\"/>");
    nodes.add("</RegisterDescription>");
    nodes.0
}

fn device(nodes: &mut Nodes) {
    nodes.text("DeviceVendorName", map::VENDOR, "RO");
    nodes.text("DeviceModelName", map::MODEL, "RO");
    nodes.text("DeviceVersion", map::DEVICE_VERSION, "RO");
    nodes.text("DeviceManufacturerInfo", map::INFORMATION, "RO");
    nodes.text("DeviceSerialNumber", map::SERIAL, "RO");
    nodes.text("DeviceUserID", map::USER_NAME, "RW");
}

const LOCKED: &str = "<pIsLocked>TLParamsLocked</pIsLocked>";

fn image_format(nodes: &mut Nodes, settings: &Settings) {
    for (size, sensor, most, offset, at, sensor_at, offset_at, step) in [
        (
            "Width",
            "SensorWidth",
            "WidthMax",
            "OffsetX",
            map::WIDTH,
            map::SENSOR_WIDTH,
            map::OFFSET_X,
            settings.step_px.0,
        ),
        (
            "Height",
            "SensorHeight",
            "HeightMax",
            "OffsetY",
            map::HEIGHT,
            map::SENSOR_HEIGHT,
            map::OFFSET_Y,
            settings.step_px.1,
        ),
    ] {
        nodes.integer(sensor, sensor_at, "RO", "");
        // What the other of the two leaves.
        for (node, other) in [(most.to_owned(), offset), (format!("{offset}Max"), size)] {
            nodes.add(&format!(
                "<IntSwissKnife Name=\"{node}\"><pVariable Name=\"S\">{sensor}Reg</pVariable>\
                 <pVariable Name=\"O\">{other}Reg</pVariable><Formula>S-O</Formula></IntSwissKnife>"
            ));
        }
        let limits = format!("<Min>{step}</Min><pMax>{most}</pMax><Inc>{step}</Inc>{LOCKED}");
        nodes.integer(size, at, "RW", &limits);
        let limits = format!("<Min>0</Min><pMax>{offset}Max</pMax><Inc>{step}</Inc>{LOCKED}");
        nodes.integer(offset, offset_at, "RW", &limits);
    }
    let formats: Vec<_> = settings
        .formats
        .iter()
        .map(|format| (format.name(), format.code()))
        .collect();
    nodes.enumeration("PixelFormat", map::PIXEL_FORMAT, "RW", None, &formats, LOCKED);
}

fn acquisition(nodes: &mut Nodes) {
    let modes = [("Continuous", 0), ("SingleFrame", 1)];
    nodes.enumeration(
        "AcquisitionMode",
        map::ACQUISITION_MODE,
        "RW",
        None,
        &modes,
        LOCKED,
    );
    nodes.command(
        "AcquisitionStart",
        1,
        "AcquisitionReg",
        Some(map::ACQUISITION),
        None,
    );
    nodes.command("AcquisitionStop", 0, "AcquisitionReg", None, None);
    nodes.boolean("AcquisitionFrameRateEnable", map::FRAME_RATE_ENABLE, None, "");
    nodes.float("AcquisitionFrameRate", map::FRAME_RATE, map::FRAME_RATES_HZ, "Hz");
    let selected = ["Mode", "Source", "Activation", "Software"]
        .map(|name| format!("<pSelected>Trigger{name}</pSelected>"))
        .concat();
    let triggers = [("FrameStart", 0), ("AcquisitionStart", 1)];
    nodes.enumeration(
        "TriggerSelector",
        map::TRIGGER_SELECTOR,
        "RW",
        None,
        &triggers,
        &selected,
    );
    let bank = Some(("TriggerSelector", map::TRIGGER_BANK));
    for (name, at, entries) in [
        ("TriggerMode", 0, &[("Off", 0), ("On", 1)][..]),
        ("TriggerSource", 4, &[("Software", 0), ("Line1", 1), ("Line3", 2)]),
        ("TriggerActivation", 8, &[("RisingEdge", 0), ("FallingEdge", 1)]),
    ] {
        nodes.enumeration(name, map::TRIGGER + at, "RW", bank, entries, "");
    }
    nodes.command(
        "TriggerSoftware",
        1,
        "TriggerSoftwareReg",
        Some(map::TRIGGER + 12),
        bank,
    );
    let modes = [("Timed", 0), ("TriggerWidth", 1)];
    nodes.enumeration("ExposureMode", map::EXPOSURE_MODE, "RW", None, &modes, "");
    nodes.float("ExposureTime", map::EXPOSURE_TIME, map::EXPOSURE_US, "us");
    nodes.float("Gain", map::GAIN, map::GAIN_DB, "dB");
    nodes.float("BlackLevel", map::BLACK_LEVEL, map::BLACK_LEVELS, "DN");
}

fn lines(nodes: &mut Nodes) {
    let lines = [("Line1", 0), ("Line2", 1), ("Line3", 2)];
    let selected = "<pSelected>LineMode</pSelected><pSelected>LineSource</pSelected>";
    nodes.enumeration("LineSelector", map::LINE_SELECTOR, "RW", None, &lines, selected);
    let bank = Some(("LineSelector", map::LINE_BANK));
    let modes = [("Input", 0), ("Output", 1)];
    nodes.enumeration("LineMode", map::LINE, "RO", bank, &modes, "");
    let sources = [("Off", 0), ("ExposureActive", 1)];
    nodes.enumeration("LineSource", map::LINE + 4, "RW", bank, &sources, "");
}

fn chunks(nodes: &mut Nodes) {
    nodes.boolean("ChunkModeActive", map::CHUNK_MODE, None, LOCKED);
    let kinds = [
        ("Image", 0),
        ("FrameID", 1),
        ("Timestamp", 2),
        ("ExposureTime", 3),
    ];
    let selected = "<pSelected>ChunkEnable</pSelected>";
    nodes.enumeration("ChunkSelector", map::CHUNK_SELECTOR, "RW", None, &kinds, selected);
    nodes.boolean(
        "ChunkEnable",
        map::CHUNK_ENABLE,
        Some(("ChunkSelector", 4)),
        LOCKED,
    );
    nodes.chunk("IntReg", "ChunkFrameID", FRAME_ID_CHUNK);
    nodes.chunk("IntReg", "ChunkTimestamp", TIMESTAMP_CHUNK);
    nodes.chunk("FloatReg", "ChunkExposureTime", EXPOSURE_CHUNK);
}

fn transport(nodes: &mut Nodes) {
    nodes.integer("PayloadSize", map::PAYLOAD_SIZE, "RO", "<Unit>B</Unit>");
    nodes.integer(
        "TLParamsLocked",
        map::PARAMETERS_LOCKED,
        "RW",
        "<Min>0</Min><Max>1</Max>",
    );
    nodes.add(
        "<MaskedIntReg Name=\"GevVersionMajor\"><Address>0</Address><Length>4</Length>\
         <AccessMode>RO</AccessMode><pPort>Device</pPort><LSB>15</LSB><MSB>0</MSB>\
         <Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>",
    );
    let (least, most) = map::HEARTBEAT_MS;
    let limits = format!("<Min>{least}</Min><Max>{most}</Max><Unit>ms</Unit>");
    nodes.integer("GevHeartbeatTimeout", map::HEARTBEAT, "RW", &limits);
    for (name, at) in [
        ("GevTimestampTickFrequency", map::TICK_HZ),
        ("GevTimestampValue", map::TIMESTAMP),
    ] {
        nodes.feature("Integer", name, &format!("<pValue>{name}Reg</pValue>"));
        nodes.register("IntReg", &format!("{name}Reg"), at, (8, "RO"), None);
    }
    let control = "GevTimestampControlReg";
    nodes.command(
        "GevTimestampControlLatch",
        2,
        control,
        Some(map::TIMESTAMP_CONTROL),
        None,
    );
    nodes.command("GevTimestampControlReset", 1, control, None, None);
    nodes.integer(
        "GevSCPHostPort",
        map::STREAM_PORT,
        "RW",
        "<Min>0</Min><Max>65535</Max>",
    );
    nodes.integer("GevSCDA", map::DESTINATION, "RW", "");
    nodes.integer("GevSCPD", map::PACKET_DELAY, "RW", "");
    let (least, most) = map::PACKET_BYTES;
    nodes.feature(
        "Integer",
        "GevSCPSPacketSize",
        &format!(
            "<pValue>GevSCPSPacketSizeReg</pValue><Min>{least}</Min><Max>{most}</Max><Inc>4</Inc>{LOCKED}"
        ),
    );
    nodes.packet_size_bits("GevSCPSPacketSizeReg", "<LSB>31</LSB><MSB>16</MSB>");
    for (name, bit) in [("GevSCPSDoNotFragment", 1), ("GevSCPSFireTestPacket", 0)] {
        let inside = format!("<pValue>{name}Reg</pValue><OnValue>1</OnValue><OffValue>0</OffValue>");
        nodes.feature("Boolean", name, &inside);
        nodes.packet_size_bits(&format!("{name}Reg"), &format!("<Bit>{bit}</Bit>"));
    }
}
