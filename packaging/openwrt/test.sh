#!/bin/sh
# shellcheck shell=dash
# Run by OpenWrt's CI on the target, with the name and the version of each package that it has installed.

case "$1" in
python3-barewire)
	python3 - "$2" <<-'EOF'
	import sys

	import barewire

	assert barewire.__version__ == sys.argv[1], barewire.__version__
	with (
	    barewire.ModbusServer("tcp://127.0.0.1:0", units={1: barewire.Table()}) as server,
	    barewire.ModbusClient(server.url, unit=1, timeout=10) as client,
	):
	    client.write_single_register(7, 42)
	    assert client.read_holding_registers(7, 1) == (42,)
	EOF
	;;
python3-barewire-devices)
	python3 -c 'import barewire; assert barewire.load("az3").name == "az3"'
	;;
python3-barewire-simulators)
	python3 -c 'import barewire; barewire.ModbusServer("tcp://127.0.0.1:0", {1: "csd-mt"})'
	;;
python3-barewire-canopen)
	python3 -c 'from barewire.canopen import CanFrame; import barewire; barewire.CanopenClient'
	;;
barewire-gateway)
	python3 -m barewire.gateway --check /etc/barewire/gateway.toml
	;;
*)
	exit 1
	;;
esac
