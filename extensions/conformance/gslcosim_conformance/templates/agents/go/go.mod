module NAME

go 1.23
