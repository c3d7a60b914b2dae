// The role in a certificate of Modbus/TCP Security: one UTF8String in an extension, in DER.

import { fromBig, parseBytes, refuseUnless, showBytes } from '../hex.mjs';

const ROLE = '2B 06 01 04 01 83 89 0C 86 22 01'; // 1.3.6.1.4.1.50316.802.1
const [OID, OCTETS, SEQUENCE, UTF8_STRING] = [0x06, 0x04, 0x30, 0x0c];

/** The elements that lie one behind the other in these bytes: tag and content. */
function elements(bytes) {
  const found = [];
  for (let at = 0; at < bytes.length; ) {
    refuseUnless(bytes.length >= at + 2, 'short');
    const [tag, first] = bytes.slice(at, at + 2);
    refuseUnless(first !== 0x80, 'value', 'a length that is not given');
    const size = first > 0x80 ? first & 0x7f : 0;
    refuseUnless(bytes.length >= at + 2 + size, 'short');
    const length = size ? fromBig(bytes.slice(at + 2, at + 2 + size)) : first;
    at += 2 + size + length;
    refuseUnless(bytes.length >= at, 'short');
    found.push({ tag, content: bytes.slice(at - length, at) });
  }
  return found;
}

function text(octets) {
  const [only, ...more] = elements(octets);
  refuseUnless(only, 'short', 'no text');
  refuseUnless(more.length === 0 && only.tag === UTF8_STRING, 'value', 'not one UTF8String');
  try {
    return new TextDecoder('utf-8', { fatal: true, ignoreBOM: true }).decode(Uint8Array.from(only.content));
  } catch {
    return refuseUnless(false, 'value', 'not UTF-8');
  }
}

export const KINDS = {
  'tls-role': {
    decode({ extensions }) {
      const [list] = elements(parseBytes(extensions));
      refuseUnless(list?.tag === SEQUENCE, 'value');
      const roles = [];
      for (const extension of elements(list.content)) {
        const parts = elements(extension.content);
        const octets = parts.find(({ tag }) => tag === OCTETS);
        if (parts[0]?.tag === OID && showBytes(parts[0].content) === ROLE && octets) roles.push(text(octets.content));
      }
      refuseUnless(roles.length <= 1, 'value', 'several roles');
      return { role: roles[0] ?? null };
    },
  },
};
