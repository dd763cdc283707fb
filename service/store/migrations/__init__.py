"""How the tables came to be, step by step: `upgrade` brings any older database up to date."""
