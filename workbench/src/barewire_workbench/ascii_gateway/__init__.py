"""The ASCII gateway: a CANopen net in lines of text, for netcat and scripts. `barewire.gateway` is another program.
[CiA 309-3]

        people and scripts                   the gateway                          the bus
        [1] 5 read 0x6041 0 u16      ->      parsed, executed             ->      605h | 40 41 60 00 ...
        [1] 1591                     <-      the response as text         <-      585h | 4B 41 60 00 37 06 ...
        1 5 BOOT_UP                  <-      a notice, if it is enabled   <-      705h | 00

Files, in reading order:

    lines        the text of lines, values, errors
    session      the table of commands, and what each does; settings     lss_commands   the LSS commands
    notices      lines without a command of their own; PDOs              own_node       the gateway as a node of the net

The syntax and the numbers are those of CiA 309-3. Its text is not public, so they are taken from two open gateways that
follow it. What both leave open is stated where it is decided: unsigned numbers are written in decimal (`x16` for
hexadecimal), a read without a type returns the bytes.
"""
