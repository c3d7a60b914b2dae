"""CANopenNode (C) as an adapter: its devices and masters on a bus that only records, in virtual time.

The library that peer.toml builds has in it CANopenNode, with the settings of CO_driver_target.h, and the files in C
beside this one.
"""

from __future__ import annotations

import values
from adapter import serve
from device import device, node_talk
from masters import gateway, heartbeat_watch, lss_talk, sdo_client, sdo_server
from tested import TESTED_ANSWERS

serve(
    "CANopenNode",
    {
        "device": {"run": device},
        "node-talk": {"run": node_talk},
        "sdo-talk": {"client": sdo_client, "server": sdo_server},
        "lss-talk": {"run": lss_talk},
        "heartbeat-watch": {"run": heartbeat_watch},
        "gateway-309-3": {"run": gateway},
        "cob-id": {"encode": values.cob_id},
        "cob-restricted": {"decode": values.restricted},
        "heartbeat-consumer": {"decode": values.heartbeat_consumer},
        "lss": {"encode": values.lss_frame},
        **TESTED_ANSWERS,
    },
)
