# R's BMS (Feldkircher and Zeugner, J. Stat. Softw. 68, 2015), which visits every structure one after the other, under a g-prior worth
# one row: reads a table without a header, response first, from stdin; prints seconds, then the inclusion probability of each term.
suppressMessages(library(BMS))
data <- as.matrix(read.csv(file("stdin"), header = FALSE))
colnames(data) <- c("y", paste0("t", seq_len(ncol(data) - 1)))
seconds <- system.time(
  found <- bms(data, burn = 0, iter = NA, g = "UIP", mprior = "uniform", mcmc = "enumerate", user.int = FALSE)
)["elapsed"]
cat(format(seconds, digits = 6), format(coef(found, order.by.pip = FALSE)[, "PIP"], digits = 15), sep = "\n")
