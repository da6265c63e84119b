"""Logs of any format below the channel map: tables of named numeric columns, catalogued and streamed alike."""
