SUMMARY = "Modbus (RTU, ASCII, TCP) and CANopen in pure Python"
SUMMARY:${PN}-canopen = "CANopen for barewire: SDO, PDO, NMT, LSS, EDS"
SUMMARY:${PN}-devices = "Names, units and addresses of the values of machines, for barewire"
SUMMARY:${PN}-simulators = "Simulated machines, for barewire"
SUMMARY:barewire-gateway = "Gateway between Modbus clients and serial lines or CAN buses"
DESCRIPTION = "Clients, servers and a gateway for Modbus and CANopen, split into packages by what a machine does."
SECTION = "devel/python"
LICENSE = "MIT"
LIC_FILES_CHKSUM = "file://LICENSE;md5=34190988962d6c6f1c6adaeadd9b2a78"

CVE_PRODUCT = "python:barewire"

# Written by packaging/checksum when a version is released.
SRC_URI[sha256sum] = "0000000000000000000000000000000000000000000000000000000000000000"

inherit pypi python_setuptools_build_meta systemd useradd

# serial: ports for RTU and ASCII lines; can: adapters other than SocketCAN
PACKAGECONFIG ??= "serial"
PACKAGECONFIG[can] = ",,,python3-can"
PACKAGECONFIG[serial] = ",,,python3-pyserial"

SYSTEMD_PACKAGES = "barewire-gateway"
SYSTEMD_SERVICE:barewire-gateway = "barewire-gateway.service"
# It starts when its configuration has been written, by the image or by hand.
SYSTEMD_AUTO_ENABLE:barewire-gateway = "disable"

USERADD_PACKAGES = "barewire-gateway"
USERADD_PARAM:barewire-gateway = "--system --user-group --no-create-home --home-dir ${localstatedir}/lib/barewire --shell /sbin/nologin barewire"

do_install:append() {
    install -d ${D}${systemd_system_unitdir} ${D}${sysconfdir}/barewire
    # The unit of the source distribution, with the interpreter of the image.
    sed 's,/opt/barewire/bin/python,${bindir}/python3,' ${S}/packaging/barewire-gateway.service \
        > ${D}${systemd_system_unitdir}/barewire-gateway.service
    # It may have the password of a broker: root writes it, the service reads it, nobody else does.
    PYTHONPATH=${S}/src nativepython3 -B -m barewire.gateway --example > ${D}${sysconfdir}/barewire/gateway.toml
    chown root:barewire ${D}${sysconfdir}/barewire/gateway.toml
    chmod 0640 ${D}${sysconfdir}/barewire/gateway.toml
}

# A file goes into the first package that names it; ${PN} has what is left: Modbus, its three framings, its ports.
PACKAGES =+ "${PN}-simulators ${PN}-devices ${PN}-canopen barewire-gateway"

FILES:${PN}-canopen += "\
    ${PYTHON_SITEPACKAGES_DIR}/barewire/canopen \
    ${PYTHON_SITEPACKAGES_DIR}/barewire/io/canopen \
    ${PYTHON_SITEPACKAGES_DIR}/barewire/io/ports/can \
    ${PYTHON_SITEPACKAGES_DIR}/barewire/io/server/can.py \
"

FILES:${PN}-devices += "${PYTHON_SITEPACKAGES_DIR}/barewire/devices"

FILES:${PN}-simulators += "${PYTHON_SITEPACKAGES_DIR}/barewire/devices/sim"

FILES:barewire-gateway += "\
    ${PYTHON_SITEPACKAGES_DIR}/barewire/gateway \
    ${systemd_system_unitdir}/barewire-gateway.service \
    ${sysconfdir}/barewire \
"
CONFFILES:barewire-gateway = "${sysconfdir}/barewire/gateway.toml"

RDEPENDS:${PN} = "\
    python3-asyncio \
    python3-core \
    python3-difflib \
    python3-fcntl \
    python3-io \
    python3-json \
    python3-logging \
    python3-math \
    python3-resource \
    python3-shell \
    python3-terminal \
"
RDEPENDS:${PN}-canopen = "\
    ${PN}-devices \
    python3-datetime \
    python3-threading \
"
RDEPENDS:${PN}-devices = "\
    ${PN} \
    python3-numbers \
    python3-tomllib \
"
RDEPENDS:${PN}-simulators = "${PN}-devices"
RDEPENDS:barewire-gateway = "\
    ${PN}-devices \
    python3-netclient \
    python3-pyserial \
"
# Nodes on CAN buses, and the buffer of a publisher.
RRECOMMENDS:barewire-gateway = "${PN}-canopen python3-sqlite3"
