"""How much a trial would teach, and which of many teaches most."""
