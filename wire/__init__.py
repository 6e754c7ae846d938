"""What travels between programs, declared once: servers, clients, boards and files read and write it."""
